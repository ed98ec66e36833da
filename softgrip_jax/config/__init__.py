"""Configs: TOML in, scenes out, and back; the keys carry the units of people, the scenes are in SI.

`toml` reads and writes files, `modules` turns tables into scenes by the fields of their classes, `keys` names numbers
and quantities, `schema` and `template` help to write a config.
"""

from ..errors import ConfigError as ConfigError
from ..units import unit_key as unit_key
from .modules import Key as Key
from .modules import NumberKey as NumberKey
from .modules import classes_of as classes_of
from .modules import keys_of as keys_of
from .modules import leaf as leaf
from .modules import number_keys as number_keys
from .modules import presets_of as presets_of
from .modules import read_field as read_field
from .modules import read_module as read_module
from .modules import read_numbers as read_numbers
from .modules import shapes_of as shapes_of
from .modules import to_table as to_table
from .modules import type_name as type_name
from .sentences import closest as closest
from .sentences import pick as pick
from .toml import Config as Config
from .toml import dump as dump
from .toml import load as load
from .toml import question as question
from .toml import read_sections as read_sections
from .toml import read_toml as read_toml
from .toml import section_names as section_names
from .toml import standalone as standalone
from .toml import validated as validated
