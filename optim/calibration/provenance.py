"""What every calibration writes: a material for other configs, and where it comes from."""

from __future__ import annotations

import tomli_w

import softgrip_jax as sg
from softgrip_jax import config as configs
from softgrip_jax.materials.base import Material


def provenance(name: str) -> str:
    """The first line of what a calibration writes."""
    return f"Fitted to measured curves by softgrip_jax {sg.__version__}, as {name} says."


def material_text(material: Material, comment: str) -> str:
    """A file with the section [material], for `material = "..."` in a config."""
    table = {"material": configs.to_table(material, (Material,))}
    return "".join(f"# {line}\n" for line in comment.splitlines()) + tomli_w.dumps(table)
