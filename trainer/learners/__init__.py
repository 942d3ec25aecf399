"""Networks, algorithms, replay buffers: what learns."""
