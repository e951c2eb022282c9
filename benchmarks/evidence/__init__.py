"""Declaration, runner, results files and staleness of the benchmarks."""
