"""What becomes of the daemon's notices."""
from __future__ import annotations

import logging

from .errors import Refused
from .types import Notice, NoticeLevel

_LOG_LEVELS = {NoticeLevel.INFO: logging.INFO, NoticeLevel.WARNING: logging.WARNING, NoticeLevel.ERROR: logging.ERROR}

_log = logging.getLogger("rustle")


def log_notice(notice: Notice) -> None:
    """What becomes of notices unless attach() is told otherwise: the logger "rustle" gets them."""
    _log.log(_LOG_LEVELS[notice.level], "%s", notice)


def raise_notice(notice: Notice) -> None:
    """For attach(on_notice=...): warnings and errors are raised as Refused, by the session's next call."""
    if notice.level is NoticeLevel.INFO:
        log_notice(notice)
    else:
        raise Refused(notice.code, notice.message, notice.remedy, notice.field)
