"""Tangential contact: shear of an elastic layer, friction, stick and slip."""
