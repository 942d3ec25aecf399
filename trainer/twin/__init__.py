"""A twin of one's own robot, camera and floor from a short drive; teaching in it; the proof."""
