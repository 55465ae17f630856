"""Benchmarks of the package beside its peers, in one run: `python -m benchmarks [names] [--quick]`.

One module per benchmark, each with `run(quick)` that returns a `harness.Report`; `harness` measures, prints and plots.
"""
