"""Result files: a trajectory as a labelled data set, saved, and read back."""

from .dataset import to_dataset as to_dataset
from .load import RunError as RunError, load_run as load_run, saved_scenario as saved_scenario
from .save import (
    OutputError as OutputError,
    check_destination as check_destination,
    replacing as replacing,
    save as save,
)
