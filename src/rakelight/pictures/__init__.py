"""Drawings that export, report, paper and benchmarks share; arrays in, pictures out."""
