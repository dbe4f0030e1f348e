"""Laboratory: trainings, tables, benchmarks and studies. The library never imports it."""
