"""Real cameras and the sensor: statistics of recordings, and sensors that are fitted to them."""
