"""The digest for satellite modems, made of what was published last."""

from dataclasses import replace

from autonomy.digest import Digest, charted
from autonomy.geometry import LocalFrame
from autonomy.wire_values import HealthNotice, ModelSnapshot, PlanNotice, SurveyNotice


def digest_of(
    vehicle: str,
    health: HealthNotice,
    model: ModelSnapshot | None,
    plan: PlanNotice | None,
    survey: SurveyNotice | None,
) -> Digest:
    """All that matters of the newest of each; None for what has not been published yet."""
    digest = Digest(
        vehicle=vehicle,
        utc_s=_utc_s(health, model),
        lat_deg=health.lat_deg,
        lon_deg=health.lon_deg,
        heading_deg=health.heading_deg,
        groundspeed_mps=health.groundspeed_mps,
        state=health.state,
        mode=health.mode,
        armed=health.armed,
        link_ok=health.link_ok,
        fault=bool(health.journal or health.security),
        distance_m=health.distance_m or 0.0,
        samples=health.samples,
        basis_size=health.basis_size,
        rho=health.rho,
        plans=health.replans,
        units="" if survey is None else survey.units,
        route_deg=() if plan is None else plan.route_deg,
    )
    if model is None or survey is None:
        return digest
    frame = LocalFrame(model.origin_lat_deg, model.origin_lon_deg)
    coarse, mean_sd = charted(model.model, frame, survey.bounds_deg)
    return replace(
        digest,
        kernel=model.model.kernel,
        prior_mean=model.model.prior_mean,
        bounds_deg=survey.bounds_deg,
        mean_sd=mean_sd,
        coarse=coarse,
    )


def _utc_s(health: HealthNotice, model: ModelSnapshot | None) -> int | None:
    """Seconds since 1970 of the health, by the vehicle's clock."""
    if model is None or model.utc_s is None or health.model_time_s is None:
        return None
    return round(health.model_time_s + model.utc_s - model.model_time_s)
