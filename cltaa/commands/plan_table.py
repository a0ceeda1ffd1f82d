"""A sequence's plan as tables: steps, reasons, and what each costs."""

from __future__ import annotations

from rich.table import Table

from cltaa.commands.printing import Console, print_line
from cltaa.inspection.sequence_plan import Section, SequencePlan
from cltaa.printable import counted, shown


def print_plan(plan: SequencePlan) -> None:
    """Print a table for each run of frames that share a plan; one that was shown before is only named."""
    builds = counted(plan.kernels, "build")
    print_line(f"preset {shown(plan.preset)}, {builds} of the resolve, on {shown(plan.device)}")
    parts = {
        "on the device": plan.memory.device, "of frames": plan.memory.frames, "of results": plan.memory.results,
        **({"of layers": plan.memory.layers} if plan.memory.layers else {}),
        "of reading": plan.memory.reading, "of packing": plan.memory.packing, "of the program": plan.memory.program,
    }  # fmt: skip
    told = " + ".join(f"{size / 1e6:.0f} {what}" for what, size in parts.items())
    print_line(f"memory at the peak: {plan.memory.whole / 1e6:.0f} MB = {told}")
    before: dict[tuple[tuple[str, bool, str], ...], str] = {}
    for section in plan.sections:
        first, last = section.first, section.last
        frames = f"frame {first}" if first == last else f"frames {first} to {last}"
        title = frames + (", history begins" if section.starts else "")
        key = tuple((step.name, step.on, step.why) for step in section.steps)
        if key in before:
            print_line(f"{title}: as {before[key]}")
            continue
        before[key] = frames
        Console().print(_table(section, title))


def _table(section: Section, title: str) -> Table:
    planned, every = section.milliseconds, section.every_milliseconds
    if planned is not None and every is not None:
        # Without what would make another estimate, such as the test for a change of light: that has its own line alone.
        same_bits = f"{every:.2f} with every step that leaves the bits as they are ({every / planned:.2f} x)"
        title += f": {planned:.2f} ms a frame, {same_bits}"
    table = Table(title=title, title_justify="left", box=None, padding=(0, 2, 0, 0))
    for heading in ("step", "runs", "why"):
        table.add_column(heading)
    table.add_column("ms a frame", justify="right")
    for step in section.steps:
        cost = "" if step.milliseconds is None else f"{step.milliseconds:+.2f}"
        # What runs is paid for; what does not is shown in brackets as what it would cost.
        table.add_row(step.name, "yes" if step.on else "no", step.why, cost if step.on or not cost else f"({cost})")
    return table
