"""From a DIGIT and a ball to a translator of that DIGIT's own frames."""
