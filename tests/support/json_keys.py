"""Keys of JSON values."""


def keys(value, prefix=""):
    """Return the paths of all keys in a JSON value; the items of a list have the same path."""
    if isinstance(value, dict):
        return {path for name, part in value.items() for path in {prefix + name} | keys(part, f"{prefix}{name}.")}
    if isinstance(value, list):
        return {path for part in value for path in keys(part, prefix)}
    return set()
