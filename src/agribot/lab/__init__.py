"""Training, data sets, benchmarks and sweeps: nothing that a robot in the field needs."""
