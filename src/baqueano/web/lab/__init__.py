"""Run the worker: a child of the page process that reads runs and computes, over pipes and without a socket.

worker_client  the page's end of the pipes
worker         the child: python -m baqueano.web.lab.worker
recorded       a run as rows of values, with its description
run_list       the runs of a folder, and their reports
"""
