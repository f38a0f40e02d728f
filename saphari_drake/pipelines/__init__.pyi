from .contact import (
    ContactMeasurements as ContactMeasurements,
)
from .contact import (
    ContactPipeline as ContactPipeline,
)
from .contact import (
    ContactPipelineParameters as ContactPipelineParameters,
)
from .contact import (
    add_contact_pipeline as add_contact_pipeline,
)
from .envelope import (
    JointState as JointState,
)
from .envelope import (
    add_joint_envelope as add_joint_envelope,
)
from .hand_guiding import (
    HandGuidingMeasurements as HandGuidingMeasurements,
)
from .hand_guiding import (
    HandGuidingPipeline as HandGuidingPipeline,
)
from .hand_guiding import (
    HandGuidingPipelineParameters as HandGuidingPipelineParameters,
)
from .hand_guiding import (
    add_hand_guiding_pipeline as add_hand_guiding_pipeline,
)
from .null_space import (
    NullSpacePipeline as NullSpacePipeline,
)
from .null_space import (
    NullSpacePipelineParameters as NullSpacePipelineParameters,
)
from .null_space import (
    add_null_space_pipeline as add_null_space_pipeline,
)
from .safe_cell.cell import (
    SafeCell as SafeCell,
)
from .safe_cell.cell import (
    add_safe_cell as add_safe_cell,
)
from .safe_cell.job_path import (
    Job as Job,
)
from .safe_cell.parameters import (
    CellMeasurements as CellMeasurements,
)
from .safe_cell.parameters import (
    CellSetup as CellSetup,
)
from .safe_cell.parameters import (
    SafeCellParameters as SafeCellParameters,
)
from .velocity import (
    VelocityPipeline as VelocityPipeline,
)
from .velocity import (
    VelocityPipelineParameters as VelocityPipelineParameters,
)
from .velocity import (
    add_velocity_pipeline as add_velocity_pipeline,
)
