#!/usr/bin/env python3
"""Replays the trace of a build for other numbers of workers: speed-up by stage, and what the last worker waits for.

Usage: chpm build SOURCE --threads 1 --trace TRACE.json; benches/replay.py TRACE.json [WORKERS...]

The trace is to be of one thread. Spans lie in one another: a stage has phases, whose tasks may run side by side, a task may have
phases of its own (a group's members), and phases come one after another. What is in no task is serial. Workers begin tasks in their order,
those of a task that waits for them before others, as Rayon does, and there are no more such tasks than workers. Times are the threads'
processor time, so that other work on the machine shows less. Memory bandwidth is not modelled.
"""

import heapq
import json
import sys
from collections import deque

WORKERS = [2, 4, 8, 16, 64]


class Span:
    def __init__(self, event):
        self.name, self.phase = event["name"], event.get("args", {}).get("phase")
        self.start, self.end, self.busy = event["ts"], event["ts"] + event["dur"], event["tdur"] / 1e6
        self.thread, self.phases = event["tid"], {}

    def close(self):
        """What is left for the span itself, and the sum of all in it; the steps are the phases in their order."""
        self.steps = list(self.phases.values())
        tasks = [task for step in self.steps for task in step]
        self.own = max(0.0, self.busy - sum(task.total for task in tasks if task.thread == self.thread))
        self.total = self.own + sum(task.total for task in tasks)


def stages(events):
    """The stages, with all that is in them."""
    found, open_spans = [], []
    for event in sorted(events, key=lambda e: (e["ts"], -e["dur"])):
        span = Span(event)
        while open_spans and open_spans[-1].end <= span.start:
            open_spans.pop().close()
        if event["cat"] == "stage":
            found.append(span)
        elif event["tid"] != found[-1].thread:
            # A thread that a stage has beside the pool's.
            span.close()
            found[-1].phases.setdefault(span.phase, []).append(span)
            continue
        else:
            open_spans[-1].phases.setdefault(span.phase, []).append(span)
        open_spans.append(span)
    while open_spans:
        open_spans.pop().close()
    return found


def makespan(stage, workers):
    """When a stage ends on so many workers."""
    running, ready, held, now, free, begun = [], [], deque(), 0.0, workers, 0
    number = iter(range(1 << 60))

    def wake(span, parent, depth, step, length):
        """Queues a piece of a span: its own time before its first phase, or nothing after one."""
        heapq.heappush(ready, (-depth, next(number), span, parent, step, length))

    def done(span, parent, depth, step):
        """A piece has ended: the next phase begins, or the span is done and its phase has one task less."""
        nonlocal begun
        if step < len(span.steps):
            left = [len(span.steps[step]), span, parent, depth, step + 1]
            for task in span.steps[step]:
                if depth == 0:
                    held.append((task, left))
                else:
                    wake(task, left, depth + 1, 0, task.own)
            return
        if depth == 1:
            begun -= 1
        if parent is not None:
            parent[0] -= 1
            if parent[0] == 0:
                done(*parent[1:])

    wake(stage, None, 0, 0, stage.own)
    while True:
        # Tasks of the stage itself begin where nothing inside one waits, and no more than there are workers.
        while free and (ready or (held and begun < workers)):
            if not ready:
                task, left = held.popleft()
                begun += 1
                wake(task, left, 1, 0, task.own)
            depth, _, span, parent, step, length = heapq.heappop(ready)
            free -= 1
            heapq.heappush(running, (now + length, next(number), span, parent, -depth, step))
        if not running:
            return now
        now, _, span, parent, depth, step = heapq.heappop(running)
        free += 1
        done(span, parent, depth, step)


def named(stage):
    """The spans within a stage by name, in the order of their first."""
    found, open_spans = {}, [stage]
    while open_spans:
        span = open_spans.pop()
        below = [task for step in span.steps for task in step]
        open_spans.extend(reversed(below))
        for task in below:
            found.setdefault(task.name, []).append(task)
    return found


def main():
    with open(sys.argv[1], encoding="utf-8") as file:
        events = json.load(file)
    if max(e["tid"] for e in events) > 1:
        sys.exit("the trace is of several threads; record it with --threads 1")
    counts = [int(count) for count in sys.argv[2:]] or WORKERS
    found = stages(events)
    times = [[stage.total] + [makespan(stage, count) for count in counts] for stage in found]
    whole = [sum(column) for column in zip(*times)]

    print(f"{'speed-up':12}{'1: s':>9}{'serial s':>10}" + "".join(f"{count:8}" for count in counts))
    for stage, row in [*zip(found, times), (None, whole)]:
        name, serial = (stage.name, stage.own) if stage else ("all", sum(s.own for s in found))
        print(f"{name:12}{row[0]:9.3f}{serial:10.3f}" + "".join(f"{row[0] / max(t, 1e-9):8.2f}" for t in row[1:]))

    print(f"\n{'share of all':31}" + "".join(f"{count:8}" for count in counts))
    for stage, row in zip(found, times):
        print(f"{stage.name:31}" + "".join(f"{100 * t / w:7.1f}%" for t, w in zip(row[1:], whole[1:])))

    print(f"\n{'tasks':12}{'stage':12}{'count':>7}{'own s':>9}{'longest':>9}")
    for stage in found:
        for name, spans in named(stage).items():
            own, longest = sum(s.own for s in spans), max(s.total for s in spans)
            print(f"{name:12}{stage.name:12}{len(spans):7}{own:9.3f}{longest:9.3f}")


main()
