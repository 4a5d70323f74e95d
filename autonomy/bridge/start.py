"""What a bridge needs of the disk: a recording of its lines, and the signing of its link."""

import logging
from collections.abc import Mapping

from autonomy.bridge.configuration import BridgeConfiguration
from autonomy.bridge.raw_log import RawLog, raw_folder
from autonomy.mavlink.signing import read_key
from autonomy.shell.signed_link import FILE_NAME, SignedLink
from autonomy.shell.state_directory import state_directory

log = logging.getLogger("autonomy.bridge")


def open_raw_log(
    configuration: BridgeConfiguration, environment: Mapping[str, str], version: str
) -> RawLog | None:
    """The recording that is asked for; where it can't be had, the bridge goes on without, and the log says so."""
    section = configuration.raw
    if not section.enabled:
        return None
    header = {"bridge": version, "configuration": configuration.model_dump(mode="json")}
    try:
        folder = raw_folder(section.directory, configuration.instrument.name, environment)
        return RawLog(folder, header, 1e6 * section.file_mb, 1e6 * section.total_mb)
    except (OSError, ValueError) as error:
        log.error("lines are not recorded: %s", error)
        return None


def open_signing(configuration: BridgeConfiguration, environment: Mapping[str, str]) -> SignedLink | None:
    """The signing of the link, if there is a key; its timestamps go into the state directory.

    Raises:
        KeyFileError: the key that is named can't be used.
    """
    section = configuration.mavlink.signing
    key = read_key(section, environment)
    if key is None:
        return None
    try:
        folder = state_directory(f"bridge-{configuration.instrument.name}", environment)
        return SignedLink(key, section.link_id, folder / FILE_NAME)
    except (OSError, ValueError) as error:
        log.error("signing timestamps can't be kept: %s", error)
        return SignedLink(key, section.link_id, None, str(error))
