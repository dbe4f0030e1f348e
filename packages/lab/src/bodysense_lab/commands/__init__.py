"""The commands of the laboratory: train, evaluate, study, bench, data prepare and render."""
