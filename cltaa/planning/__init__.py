"""What is decided before a kernel runs: which steps a frame calls for, and how much memory they take."""
