"""From laser points to moving elements: world and scanner, the stages of the chain, fusion of stations, Kalman tracking."""
