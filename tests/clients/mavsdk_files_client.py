"""A client written with MAVSDK, run as a process of its own: moves files and logs, reads the component metadata.

    python mavsdk_files_client.py URL DIRECTORY

The directory holds upload.plan; downloads and results.json are put into it. Exit code 77 says that MAVSDK cannot be
had on this machine.
"""

import json
import sys
import threading
from pathlib import Path

# First: it ends the process with 77 where MAVSDK cannot be had.
from mavsdk_system import autopilot

# isort: split
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.component_metadata import ComponentMetadata, MetadataType
from mavsdk.plugins.ftp import Ftp
from mavsdk.plugins.log_files import LogFiles

PATIENCE_S = 40.0


def finished(start):
    """The name of the result of an operation with progress."""
    ended, results = threading.Event(), []

    def callback(result, _data, _user):
        if result.name != "NEXT":
            results.append(result.name)
            ended.set()

    start(callback)
    return results[0] if ended.wait(PATIENCE_S) else "no end"


def result_of(call, *arguments):
    try:
        call(*arguments)
    except MavsdkError as error:
        return error.result.name
    return "SUCCESS"


def move_files(system, directory):
    ftp = Ftp(system)

    def listed(path):
        return sorted((entry.entry_type.name, entry.name) for entry in ftp.list_directory(path).entries)

    def get(path, *, burst):
        return finished(lambda callback: ftp.download_async(path, str(directory), burst, callback))

    upload = str(directory / "upload.plan")
    seen = {"root": listed("/"), "logs": listed("/logs")}
    seen["downloads"] = [
        get("/logs/00000001.BIN", burst=True),
        get("/metadata/parameter.json", burst=False),
        get("@PARAM/param.pck", burst=True),
    ]
    seen["upload"] = finished(lambda callback: ftp.upload_async(upload, "/uploads", callback))
    seen["identical"] = ftp.are_files_identical(upload, "/uploads/upload.plan")
    seen["changes"] = [
        result_of(ftp.create_directory, "/uploads/old"),
        result_of(ftp.create_directory, "/uploads/old"),
        result_of(ftp.rename, "/uploads/upload.plan", "/uploads/old/first.plan"),
        result_of(ftp.remove_directory, "/uploads/old"),
        result_of(ftp.remove_file, "/uploads/old/first.plan"),
        result_of(ftp.remove_directory, "/uploads/old"),
        result_of(ftp.remove_file, "/uploads/old/first.plan"),
    ]
    seen["refused"] = [
        finished(lambda callback: ftp.upload_async(upload, "/logs", callback)),
        result_of(ftp.remove_file, "/logs/00000001.BIN"),
        result_of(ftp.list_directory, "/.."),
        get("/uploads/../parameters.param.0", burst=True),
    ]
    return seen


def fetch_logs(system, directory):
    logs = LogFiles(system)
    entries = logs.get_entries()
    results = [
        finished(
            lambda callback, entry=entry: logs.download_log_file_async(
                entry, str(directory / f"log{entry.id}.bin"), callback
            )
        )
        for entry in entries
        if entry.id  # 0 is being written
    ]
    return {"entries": [(entry.id, entry.date, entry.size_bytes) for entry in entries], "log_downloads": results}


def read_metadata(system):
    metadata = ComponentMetadata(system)
    came = threading.Event()

    def callback(update, _user):
        if update.type is MetadataType.PARAMETER:
            came.set()

    metadata.subscribe_metadata_available(callback)
    metadata.request_autopilot_component()
    if not came.wait(PATIENCE_S):
        sys.exit("waited in vain for the metadata")
    return {"metadata": json.loads(metadata.get_metadata(1, MetadataType.PARAMETER).json_metadata)}


def main():
    url, directory = sys.argv[1], Path(sys.argv[2])
    with autopilot(url) as system:
        seen = {**move_files(system, directory), **fetch_logs(system, directory), **read_metadata(system)}
        (directory / "results.json").write_text(json.dumps(seen, indent=1))


if __name__ == "__main__":
    main()
