"""Numbers as text that every reader of YAML takes for floating-point numbers, all digits kept."""

from collections.abc import Iterable

__all__ = ['yaml_list', 'yaml_number']


def yaml_number(value: float) -> str:
    """Return a float that YAML 1.1 reads as one: it wants a point before the exponent."""
    mantissa, mark, exponent = repr(float(value)).partition('e')
    return (mantissa if '.' in mantissa else mantissa + '.0') + mark + exponent


def yaml_list(values: Iterable[float]) -> str:
    """Return a list of such numbers."""
    return '[' + ', '.join(map(yaml_number, values)) + ']'
