"""From a problem to finished chains: charts, mode, first metric, starts, chains, run directory."""
