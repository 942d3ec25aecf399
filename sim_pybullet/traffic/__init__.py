"""Who else is on the road: ducks that walk, cars with drivers, lights that change."""
