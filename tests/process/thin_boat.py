"""A boat on a thin link: publishes a model every two seconds, health and a reading every second, until its input ends.

Arguments: the router's address, the rate limit in bytes per second, seconds between two readings.
"""

import sys
import threading
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
from shore_helpers import health_notice, learnt_model, model_snapshot, observation, plan_notice, survey_notice

from autonomy.effects import Topic
from autonomy.shell.publisher import Publisher


def main() -> None:
    """See the module's description."""
    endpoint, rate, reading_s = sys.argv[1], float(sys.argv[2]), float(sys.argv[3])
    model, _ = learnt_model()
    boat = Publisher("boat1", [endpoint], rate_limit_bytes_per_s=rate)
    ended = threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), ended.set()), daemon=True).start()
    boat.start()
    boat.publish(Topic.SURVEY, survey_notice())
    boat.publish(Topic.PLAN, plan_notice())
    due, made, told = time.monotonic(), 0, 0
    while not ended.wait(max(0.0, due - time.monotonic())):
        due += reading_s
        boat.publish(Topic.OBSERVATIONS, observation(made % 5000))
        made += 1
        if made * reading_s >= told:
            told += 1
            boat.publish(Topic.HEALTH, health_notice(boat.status.trouble))
            if told % 2 == 0:
                snapshot = replace(model_snapshot(model, told), utc_s=time.time())
                boat.publish(Topic.MODEL, snapshot)
    boat.stop(0.1)


if __name__ == "__main__":
    main()
