"""Tests of the live server: hostile clients and packets, a bad network, independent decoders."""
