"""The four papers, a folder each."""
