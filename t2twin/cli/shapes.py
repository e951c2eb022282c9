"""t2twin shapes"""


def shapes() -> None:
    """List the shapes that can be pressed by name, without making them."""
    from t2twin.primitives_cad.catalogue import KEYPOINTS
    from t2twin.primitives_cad.families import FAMILIES

    print("primitives, versions 1 to 4 (3 is for validation):")
    for family, versions in FAMILIES.items():
        names = [f"{family}-{number + 1}" for number in range(len(versions))]
        print("  " + "".join(f"{name:18}" for name in names).rstrip())
    print("tools at their keypoints, for the test:")
    for tool, keypoints in KEYPOINTS.items():
        names = [f"{tool}/{keypoint}" for keypoint in keypoints]
        print("  " + "".join(f"{name:22}" for name in names).rstrip())
    print("and any STL, STEP, OBJ, PLY, 3MF or GLB file, its pressing side up (+z; +y in GLB)")
