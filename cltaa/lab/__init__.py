"""Tools that measure: checks, scores, plans, benchmarks and tuning."""
