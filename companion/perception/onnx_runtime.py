"""ONNX Runtime, on one thread: the same picture gives the same output."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from companion.perception.networks import ModelError

Shapes = dict[str, list[Any]]  # by name; a size that is free has a name


def opened(model: Path, inputs: Shapes, outputs: Shapes, use: str) -> Any:
    """Return the session of an ONNX file that takes and gives what is wanted.

    use: what the file is for, in words.

    Raises:
        ModelError: ONNX Runtime is not installed (it takes 80 MB, for the packaged networks alone),
            or the file is missing, none that it reads, or one of other inputs and outputs.
    """
    if not model.is_file():
        raise ModelError(f"{model}: no such model file")
    session = _session(model)
    takes = {each.name: list(each.shape) for each in session.get_inputs()}
    gives = {each.name: list(each.shape) for each in session.get_outputs()}
    if takes != inputs or gives != outputs:
        raise ModelError(
            f"{model}: takes {takes} and gives {gives}; a network for {use} takes {inputs} and "
            f"gives {outputs}"
        )
    return session


def _session(model: Path) -> Any:
    """Return the session of a file that is there; raise ModelError as `opened`."""
    try:
        import onnxruntime
    except ModuleNotFoundError as error:
        advice = "pip install 'swarm-companion[eyes]'"
        raise ModelError(f"not installed: {error.name}; {advice}") from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        # Read as bytes: a file mapped into memory would change while it runs.
        return onnxruntime.InferenceSession(
            model.read_bytes(), options, providers=["CPUExecutionProvider"]
        )
    except Exception as error:  # ONNX Runtime's errors share no base but this
        text = " ".join(str(error).split())[:160]
        raise ModelError(f"{model}: not a model that ONNX Runtime reads: {text}") from error
