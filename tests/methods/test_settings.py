"""Settings out of range are refused with the value."""

import pytest

from curiobench.methods.agents.settings import HybridConfig, SACConfig
from curiobench.methods.decstr import DECSTRConfig
from curiobench.methods.disagreement import Disagreement
from curiobench.methods.e3b import E3B
from curiobench.methods.icm import ICM
from curiobench.methods.mcher import MultiCriteriaHERConfig
from curiobench.methods.mi import MI
from curiobench.methods.ngu import NGU
from curiobench.methods.re3 import RE3
from curiobench.methods.ride import RIDE

WRONG = {
    SACConfig: {"gamma": 1.0, "polyak": 0.0, "tau": -1.0, "hidden": 0, "temperature": 0.0}
    | {"detail_scale": 0.0, "pairs": "ordered"},
    HybridConfig: {"q_int_normalisation": "none", "popart_rate": 0.0, "spread_ratio": 0.0, "tau_rate": 2.0},
    MI.Config: {"xi": 1.0, "beta": 1.1, "m": 0.0, "k": 0, "min_log_std": 3.0},
    ICM.Config: {"beta": 1.5, "features": 0},
    RE3.Config: {"decay": 1.0, "particles": 2},
    Disagreement.Config: {"models": 1, "hidden": 0},
    E3B.Config: {"ridge": 0.0},
    RIDE.Config: {"forward_weight": 0.0},
    NGU.Config: {"epsilon": 0.0},
    DECSTRConfig: {"test_share": 1.1, "window": 0, "least": 0},
    MultiCriteriaHERConfig: {"relabel_share": 2},
}


@pytest.mark.parametrize(
    ("config", "name", "value"), [(config, *wrong) for config, values in WRONG.items() for wrong in values.items()]
)
def test_settings_out_of_range_are_refused(config, name, value):
    with pytest.raises(ValueError, match=f"{name} is '?{value}"):
        config(**{name: value})
