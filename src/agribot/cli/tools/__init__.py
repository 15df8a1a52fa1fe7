"""Commands for benchmarks, boards, receivers, calibration and plug-ins."""
