"""A client written with MAVSDK, as a separate process: it transfers files and logs and reads the component metadata.

    python mavsdk_files_client.py URL DIRECTORY

The directory contains upload.plan; the client adds downloads and results.json. Exit code 77: MAVSDK is not usable on
this machine.
"""

import json
import sys
import threading
from pathlib import Path

# First: it ends the process with code 77 if MAVSDK is not usable.
from mavsdk_system import autopilot

# isort: split
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.component_metadata import ComponentMetadata, MetadataType
from mavsdk.plugins.ftp import Ftp
from mavsdk.plugins.log_files import LogFiles

PATIENCE_S = 40.0


def wait_for_result(start):
    """Return the name of the result of an operation with progress."""
    ended, results = threading.Event(), []

    def callback(result, _data, _user):
        if result.name != "NEXT":
            results.append(result.name)
            ended.set()

    start(callback)
    return results[0] if ended.wait(PATIENCE_S) else "no end"


def result_of(call, *arguments):
    """Return the name of the result of a call."""
    try:
        call(*arguments)
    except MavsdkError as error:
        return error.result.name
    return "SUCCESS"


def transfer_files(system, directory):
    ftp = Ftp(system)

    def list_entries(path):
        return sorted((entry.entry_type.name, entry.name) for entry in ftp.list_directory(path).entries)

    def get(path, *, burst):
        return wait_for_result(lambda callback: ftp.download_async(path, str(directory), burst, callback))

    upload = str(directory / "upload.plan")
    results = {"root": list_entries("/"), "logs": list_entries("/logs")}
    results["downloads"] = [
        get("/logs/00000001.BIN", burst=True),
        get("/metadata/parameter.json", burst=False),
        get("@PARAM/param.pck", burst=True),
    ]
    results["upload"] = wait_for_result(lambda callback: ftp.upload_async(upload, "/uploads", callback))
    results["identical"] = ftp.are_files_identical(upload, "/uploads/upload.plan")
    results["changes"] = [
        result_of(ftp.create_directory, "/uploads/old"),
        result_of(ftp.create_directory, "/uploads/old"),
        result_of(ftp.rename, "/uploads/upload.plan", "/uploads/old/first.plan"),
        result_of(ftp.remove_directory, "/uploads/old"),
        result_of(ftp.remove_file, "/uploads/old/first.plan"),
        result_of(ftp.remove_directory, "/uploads/old"),
        result_of(ftp.remove_file, "/uploads/old/first.plan"),
    ]
    results["refused"] = [
        wait_for_result(lambda callback: ftp.upload_async(upload, "/logs", callback)),
        result_of(ftp.remove_file, "/logs/00000001.BIN"),
        result_of(ftp.list_directory, "/.."),
        get("/uploads/../parameters.param.0", burst=True),
    ]
    return results


def fetch_logs(system, directory):
    logs = LogFiles(system)
    entries = logs.get_entries()
    results = [
        wait_for_result(
            lambda callback, entry=entry: logs.download_log_file_async(
                entry, str(directory / f"log{entry.id}.bin"), callback
            )
        )
        for entry in entries
        if entry.id  # log 0 is being written
    ]
    return {"entries": [(entry.id, entry.date, entry.size_bytes) for entry in entries], "log_downloads": results}


def read_metadata(system):
    metadata = ComponentMetadata(system)
    is_available = threading.Event()

    def callback(update, _user):
        if update.type is MetadataType.PARAMETER:
            is_available.set()

    metadata.subscribe_metadata_available(callback)
    metadata.request_autopilot_component()
    if not is_available.wait(PATIENCE_S):
        sys.exit("no metadata received")
    return {"metadata": json.loads(metadata.get_metadata(1, MetadataType.PARAMETER).json_metadata)}


def main():
    url, directory = sys.argv[1], Path(sys.argv[2])
    with autopilot(url) as system:
        results = {**transfer_files(system, directory), **fetch_logs(system, directory), **read_metadata(system)}
        (directory / "results.json").write_text(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
