"""Painters of floors."""
