"""Mutation tests: change one thing in the source, and see whether the tests notice."""
