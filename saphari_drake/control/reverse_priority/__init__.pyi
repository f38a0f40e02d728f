from .law import PriorityStatus as PriorityStatus
from .stack import PriorityStack as PriorityStack
from .system import (
    frame_reference as frame_reference,
)
from .system import (
    position_reference as position_reference,
)
from .system import (
    scalar_reference as scalar_reference,
)
from .tasks import (
    Bound as Bound,
)
from .tasks import (
    FrameTask as FrameTask,
)
from .tasks import (
    ScalarTask as ScalarTask,
)
from .tasks import (
    joint_coordinate as joint_coordinate,
)
from .tasks import (
    joint_limits as joint_limits,
)
from .tasks import (
    plane_distance as plane_distance,
)
from .tasks import (
    pose_task as pose_task,
)
from .tasks import (
    position_task as position_task,
)
from .tasks import (
    target_distance as target_distance,
)
from .tasks import (
    view_cosine as view_cosine,
)
