"""ONNX Runtime, on one thread: the same picture gives the same output."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from companion.perception.networks import ModelError


def opened(model: Path) -> Any:
    """Return the session of an ONNX file.

    Raises:
        ModelError: ONNX Runtime is not installed (it takes 80 MB, for the packaged networks alone),
            or the file is missing or none that it reads.
    """
    if not model.is_file():
        raise ModelError(f"{model}: no such model file")
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


def shapes(session: Any) -> tuple[dict[str, list[Any]], dict[str, list[Any]]]:
    """Return the shapes of a session's inputs and outputs, by their names."""
    takes = {each.name: list(each.shape) for each in session.get_inputs()}
    return takes, {each.name: list(each.shape) for each in session.get_outputs()}
