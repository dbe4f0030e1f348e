"""What a completion network's file names as its format."""

FORMAT = "bodysense-completion-1"
