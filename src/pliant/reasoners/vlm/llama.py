"""Serves a model with llama.cpp on the loopback address, until standard input ends.

`local` runs this file as a program: it imports nothing of pliant, so that it is up at once and
small. Its first line of output is the server's address; its errors are llama.cpp's own log.
"""

import argparse
import os
import sys
from importlib import import_module

CONVERSATIONS = 4  # at a time; what begins alike in them is read once
CONTEXT_TOKENS = CONVERSATIONS * 2048
_LOG_ERRORS = 1


def serve(model: str, projector: str, name: str, port: int) -> None:
    """Say the address when all is loaded, then serve. Port 0 is any that is free."""
    xllamacpp = import_module("xllamacpp")
    params = xllamacpp.CommonParams()
    params.model.path, params.mmproj.path, params.model_alias = model, projector, {name}
    params.hostnames, params.port = ["127.0.0.1"], port
    params.offline, params.ui, params.endpoint_slots = True, False, False
    params.cors_origins = "http://127.0.0.1"  # no page of the web may ask it
    params.n_ctx, params.n_parallel, params.kv_unified = CONTEXT_TOKENS, CONVERSATIONS, True
    params.fit_params = False
    params.cache_prompt, params.cache_ram_mib, params.cache_idle_slots = True, 0, False
    params.use_jinja = params.enable_chat_template = True
    params.n_gpu_layers, params.mmproj_use_gpu = 0, False  # the same replies on every machine
    # Two threads wait for each other: on two cores in use elsewhere too they are the slower.
    params.cpuparams.n_threads = params.cpuparams_batch.n_threads = 1
    params.n_threads_http = CONVERSATIONS
    params.verbosity = _LOG_ERRORS
    server = xllamacpp.Server(params)  # returns when all is loaded
    sys.stdout.write(f"{server.listening_address}\n")
    sys.stdout.flush()
    sys.stdin.read()
    os._exit(0)  # whatever it is doing


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for option in ("--model", "--projector", "--name"):
        parser.add_argument(option, required=True)
    parser.add_argument("--port", type=int, required=True)
    serve(**vars(parser.parse_args()))
