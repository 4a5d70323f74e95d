"""Whether what has come is newer than what is held. Runs of a vehicle's software have no order; within one there is."""

from autonomy import wire
from autonomy.shore.roster import VehicleView


def same_model(held: wire.ModelSnapshot | None, came: wire.ModelSnapshot) -> bool:
    """Whether a model is held already, perhaps at another precision."""
    return held is not None and _place(held) == _place(came)


def is_older(view: VehicleView, came: wire.Message) -> bool:
    """Whether something was told before what is held of its kind, in the same run; False if that cannot be known."""
    match came:
        case wire.ModelSnapshot():
            return view.model is not None and _precedes(came, view.model)
        case wire.PlanNotice():
            return view.plan is not None and _precedes(came, view.plan)
        case wire.HealthNotice():
            return view.health is not None and came.run == view.health.run and _was(came, view.health)
    return False


def _place(model: wire.ModelSnapshot) -> tuple[int, int, float]:
    return model.run, model.sequence, model.model_time_s


def _precedes(came: wire.ModelSnapshot | wire.PlanNotice, held: wire.ModelSnapshot | wire.PlanNotice) -> bool:
    return came.run == held.run and came.sequence < held.sequence


def _was(came: wire.HealthNotice, held: wire.HealthNotice) -> bool:
    """What has been told only grows; while nothing is told, the vehicle's clock goes on."""
    if came.observations_end != held.observations_end:
        return came.observations_end < held.observations_end
    if came.log_end != held.log_end:
        return came.log_end < held.log_end
    return (
        came.model_time_s is not None
        and held.model_time_s is not None
        and came.model_time_s < held.model_time_s
    )
