"""What is known of a person at each time, from any device."""
