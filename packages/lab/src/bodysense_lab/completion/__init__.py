"""The completion network: how it is built, taught and scored."""
