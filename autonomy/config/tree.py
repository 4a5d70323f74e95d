"""The configuration tree: all sections, and what must hold between them."""

from collections.abc import Iterator

from pydantic import Field

from autonomy.config.sections.learning import LEAST_CHOSEN_CAPACITY, EstimationSection, ModelSection
from autonomy.config.sections.planning import BudgetSection, ExplorationSection, PlanningSection
from autonomy.config.sections.readings import QualitySection, SamplingSection, SensorSection, SurveySection
from autonomy.config.sections.section import Conflict, Section
from autonomy.config.sections.service import CheckpointSection, JournalSection, LoggingSection, ShoreSection
from autonomy.config.sections.vehicle import AuthoritySection, MavlinkSection, VehicleSection


class Configuration(Section):
    """Everything a run depends on."""

    vehicle: VehicleSection = VehicleSection()
    mavlink: MavlinkSection = MavlinkSection()
    authority: AuthoritySection = AuthoritySection()
    sensor: SensorSection = SensorSection()
    survey: SurveySection
    sampling: SamplingSection = SamplingSection()
    quality: QualitySection = QualitySection()
    model: ModelSection = ModelSection()
    estimation: EstimationSection = EstimationSection()
    exploration: ExplorationSection = ExplorationSection()
    planning: PlanningSection = PlanningSection()
    budget: BudgetSection = BudgetSection()
    shore: ShoreSection = ShoreSection()
    journal: JournalSection = JournalSection()
    checkpoint: CheckpointSection = CheckpointSection()
    logging: LoggingSection = LoggingSection()
    seed: int = Field(
        default=0, ge=0, description="seed of every random choice; runs with equal inputs are equal"
    )

    def conflicts(self) -> Iterator[Conflict]:
        """A basis that can't grow to its minimum would never re-estimate; a boat that holds has not stalled."""
        stall_s, hold_s = self.exploration.stall_s, self.planning.hold_s
        if stall_s is not None and hold_s >= stall_s:
            what = f"must be below exploration.stall_s ({stall_s:g}) (got {hold_s:g})"
            keys = ("planning.hold_s", "exploration.stall_s")
            yield Conflict(keys, what, "planning.hold_s < exploration.stall_s")
        if hold_s > 0.0 and (self.budget.duration_s is not None or self.budget.energy_wh is not None):
            limit = "duration_s" if self.budget.duration_s is not None else "energy_wh"
            what = f"must be 0 with budget.{limit}: what holding costs is not counted (got {hold_s:g})"
            yield Conflict(
                ("planning.hold_s", f"budget.{limit}"), what, "planning.hold_s: 0, or no such limit"
            )
        minimum, capacity = self.exploration.minimum_basis, self.model.capacity
        keys = ("exploration.minimum_basis", "model.capacity")
        if capacity is not None and capacity < minimum:
            what = f"must be at most model.capacity ({capacity}) (got {minimum})"
            yield Conflict(keys, what, "exploration.minimum_basis <= model.capacity")
        if capacity is None and minimum > LEAST_CHOSEN_CAPACITY:
            what = f"must be at most {LEAST_CHOSEN_CAPACITY} while model.capacity is null (got {minimum})"
            yield Conflict(
                keys, what, f"at most {LEAST_CHOSEN_CAPACITY}, or a model.capacity of at least as much"
            )
