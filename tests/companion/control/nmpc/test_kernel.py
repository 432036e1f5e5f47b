"""The structures of the kernel are the same in C and in Python."""

import ctypes
import re
from ctypes import POINTER, c_double, c_int, c_longlong, c_void_p
from pathlib import Path

import pytest

from companion.control.nmpc import kernel
from companion.model import NU

FILES = (*kernel.PROGRAM_FILES, kernel.SWEEP_FILE)
SOURCE = "\n".join((Path(kernel.__file__).parent / name).read_text() for name in FILES)
TYPES = {
    "int": c_int,
    "double": c_double,
    "Piece": kernel.PieceStructure,
    "double[NU]": c_double * NU,
    "const int *": POINTER(c_int),
    "const double *": POINTER(c_double),
    "double *": POINTER(c_double),
    "long long *": POINTER(c_longlong),
    "double *const *": POINTER(POINTER(c_double)),
    "void *": c_void_p,
}


def fields(name):
    """Names and types of a structure in C, one field a line."""
    body = re.search(rf"typedef struct {{([^}}]*)}} {name};", SOURCE)[1]
    lines = [line.split("/*")[0].strip().rstrip(";") for line in body.strip().splitlines()]
    declared = [re.fullmatch(r"(.*?)(\w+)(\[\w+\])?", line).groups() for line in lines]
    return [(field, TYPES[kind.strip() + (size or "")]) for kind, field, size in declared]


@pytest.mark.parametrize(
    ("name", "structure"),
    [
        ("Piece", kernel.PieceStructure),
        ("Program", kernel.ProgramStructure),
        ("Sweep", kernel.SweepStructure),
    ],
)
def test_each_structure_has_the_same_fields_in_c(name, structure):
    assert fields(name) == list(structure._fields_)
    assert issubclass(structure, ctypes.Structure)


def test_no_size_is_written_in_c():
    """All sizes come by -D from Python."""
    for name in kernel.SIZES:
        assert re.search(rf"\b{name}\b", SOURCE), name
        assert not re.search(rf"#define {name}\b", SOURCE), name
