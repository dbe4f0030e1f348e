"""The tracker: observations in, whole bodies out, by the compiled core."""
