"""One module a subcommand of ``cltaa``; each holds one click command and no logic of its own."""
