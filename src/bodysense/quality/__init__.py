"""Quality of motion: is it a person, and does it move like one."""
