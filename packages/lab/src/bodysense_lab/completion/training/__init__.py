"""Tasks, losses and options of the completion trainings."""
