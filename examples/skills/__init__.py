"""Three skills of a gripper that are learned with one tactile sensor and used with another.

python -m examples.skills train runs/skills
python -m examples.skills evaluate runs/skills
"""
