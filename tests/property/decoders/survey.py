"""The survey that all of it is about."""

import shapely

from autonomy.config import Configuration
from autonomy.geometry import LocalFrame
from autonomy.planning.survey import SurveyArea

AREA = [(33.4, -118.6), (33.4, -118.4), (33.6, -118.4), (33.6, -118.6)]
CONFIGURATION = Configuration.model_validate({"survey": {"area": AREA}})
FRAME = LocalFrame(33.5, -118.5)
SURVEY = SurveyArea.from_geometry(FRAME, shapely.box(0, 0, 3000, 2000), passage_cells=20)
