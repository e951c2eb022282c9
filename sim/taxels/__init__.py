"""The CySkin: taxel layouts, counts under a pressure, and tactile images."""
