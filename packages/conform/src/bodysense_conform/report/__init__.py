"""Reports of a verdict: JSON, JUnit XML, HTML."""
