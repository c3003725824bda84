"""A labelled vehicle, from docs/protocol.md alone: ``python own_module.py ENDPOINT MODULE``."""

import json
import sys
import tomllib
from math import dist
from queue import Empty, SimpleQueue
from typing import Any

import zenoh


def draw(key: int, index: int) -> int:
    found = (key + (index + 1) * 0x9E3779B97F4A7C15) % 2**64
    found = (found ^ found >> 30) * 0xBF58476D1CE4E5B9 % 2**64
    found = (found ^ found >> 27) * 0x94D049BB133111EB % 2**64
    return found ^ found >> 31


class Vehicle:
    def __init__(self, session: zenoh.Session, root: str, reply: bytes) -> None:
        self.session, self.root, self.orders = session, root, json.loads(reply)["orders"]
        self.name, (self.module,) = f"process_{self.orders['process']}", self.orders["modules"]
        self.token = session.liveliness().declare_token(f"{root}/alive/{self.name}")
        scene = tomllib.loads(self.orders["scene"])
        self.edges = [{(*one,), (*other,)} for one, other in scene["graph"]["edges"]]
        (place, self.label), (self.goal,) = scene["start"][self.module], scene["goals"][self.module]
        self.place: Any = (*place,)
        self.round, self.phase, self.due, self.wait_s = 0, "join", (0, ""), 1.0
        self.asked: Any = None
        self.inbox: dict[tuple[int, str, str], set[tuple[int, int]]] = {}
        self.parts: dict[tuple[int, str, int], Any] = {}
        self.heard: dict[str, list[int]] = {}
        self.told: list[tuple[str, str, str, str]] = []
        self.came: SimpleQueue[zenoh.Sample] = SimpleQueue()
        for kind in ("go", "retransmit", "to"):
            enqueue = zenoh.handlers.Callback(self.came.put, indirect=False)
            session.declare_subscriber(f"{root}/{kind}/**", enqueue)

    def put(self, kind: str, to: str = "", **fields: Any) -> None:
        message = {"kind": kind, "round": self.round, "process": self.orders["process"], **fields}
        key = f"{self.root}/{f'to/{to}' if to else kind}/{self.name}"
        told = self.phase, to or kind, key, json.dumps(message)
        self.told += [] if kind in ("retransmit", "waiting") else [told]
        self.repeat([told])

    def repeat(self, told: list[tuple[str, str, str, str]]) -> None:
        for _, _, key, data in told:
            self.session.put(key, data, congestion_control=zenoh.CongestionControl.BLOCK)

    def say(self, kind: str, places: Any, **fields: Any) -> None:
        site = [self.place, self.label]
        part = {"kind": kind, "round": self.round, "module": self.module, "site": site, **fields}
        for to in sorted({f"{x // 8},{y // 8}" for x, y in places}):
            self.put("bundle", to, phase=self.phase, region=to, number=0, parts=[part])

    def receive(self, key: str, message: Any) -> None:
        at, who = (message["round"], message["phase"]), message.get("process")
        if key in ("/go/coordinator", f"/go/{self.name}"):
            if at[1] == "stop":
                sys.exit()
            if at == (self.round, self.phase):
                self.repeat([each for each in self.told if each[0] == self.phase])
            if (at == self.due and self.asked) or (at[1] == "settle" and not self.due[0]):
                self.put("waiting", round=at[0], phase=at[1])
            if at == self.due:
                self.asked, self.wait_s = message, 1.0
        elif key == f"/retransmit/process_{who}" and at[0] == self.round:
            self.repeat([each for each in self.told if each[:2] == (at[1], message["region"])])
        elif key == f"/to/{message.get('region')}/process_{who}":
            self.inbox.setdefault((*at, message["region"]), set()).add((who, message["number"]))
            for part in message["parts"]:
                if part["module"] in self.orders["processes"][who]:
                    self.parts[at[0], part["kind"], part["module"]] = part

    def step(self, missing: str) -> None:
        try:
            sample = self.came.get(timeout=self.wait_s)
            message = json.loads(sample.payload.to_bytes())
            self.receive(str(sample.key_expr).removeprefix(self.root), message)
        except Empty:
            lead = self.session.liveliness().get(f"{self.root}/alive/coordinator")
            if self.wait_s == 4.0 and not list(lead):
                sys.exit("the coordinator is gone")
            if self.phase == "join" and not self.asked:
                self.repeat(self.told)
            elif missing and (self.asked or not self.due[0]):
                self.put("retransmit", phase=missing, region=self.here)
            self.wait_s = min(2 * self.wait_s, 4.0)

    def begin(self, phase: str, before: str = "") -> None:
        regions = [to for phase, to, *_ in self.told if phase == self.phase and to != "reports"]
        self.put("ready", phase=self.phase, sent=dict.fromkeys(regions, 1), rule="own")
        self.asked, self.due = None, (self.round + (phase == "sense"), phase)
        self.here = f"{self.place[0] // 8},{self.place[1] // 8}"
        heard = self.inbox.setdefault((self.round, before, self.here), set())  # itself, too
        while not self.asked or self.asked.get("sent", {}).get(self.here, 0) > len(heard):
            self.step(before)
        (self.round, self.phase), self.due = self.due, (0, "")

    def hear(self, kind: str, near: set[Any]) -> dict[int, Any]:
        now = {key[2]: part for key, part in self.parts.items() if key[:2] == (self.round, kind)}
        found = {module: now[module] for module in now if (*now[module]["site"][0],) in near}
        self.heard[kind] = sorted(found)
        return found

    def rank(self, module: int) -> tuple[int, int]:
        key, seed = draw(0, 3), self.orders["seed"]
        while True:
            key, seed = draw(key, seed % 2**64), seed >> 64
            if not seed:
                return draw(draw(key, self.round), module), module

    def near(self, place: Any) -> set[Any]:
        return {end for edge in self.edges if place in edge for end in edge} - {place}

    def play(self) -> None:
        self.begin("sense")
        self.told, self.heard = [], {}
        near, away = self.near(self.place), dist(self.place, self.goal)
        reach = near.union(*map(self.near, near)) - {self.place}
        self.say("presence", near)
        self.begin("claim", "sense")
        self.hear("note", reach)
        free = sorted(near - {(*part["site"][0],) for part in self.hear("presence", near).values()})
        nearer = [place for place in free if dist(place, self.goal) < away]
        ways = nearer or (free if away and self.rank(-1)[0] % 2 else [])  # as good as random
        ends = {self.place, ways[(self.rank(-1)[0] >> 8) % len(ways)]} if ways else set()
        move = {"generator": "edge", "at": [*sorted(ends), self.label]}
        self.say("claim", reach if ends else (), **move)
        self.begin("settle", "claim")
        claims = self.hear("claim", reach)
        rivals = [each for each in claims if ends & {(*end,) for end in claims[each]["at"][:2]}]
        before = sorted(each for each in rivals if self.rank(each) > self.rank(self.module))
        after = [claims[each]["site"][0] for each in rivals if each not in before]
        while not all((self.round, "verdict", each) in self.parts for each in before):
            self.step("settle")
        lost = any(self.parts[self.round, "verdict", each]["granted"] for each in before)
        granted = bool(ends) and not lost
        self.say("verdict", after, granted=granted, to=after)
        report = {"kind": "report", "round": self.round, "module": self.module}
        report |= {"before": [self.place, self.label], "move": move if granted else None}
        report["claim"] = ("granted" if granted else "lost") if ends else "none"
        (self.place,) = ends - {self.place} if granted else {self.place}
        report |= {"site": [self.place, self.label], "received": {**self.heard, "verdict": before}}
        self.put("reports", parts=[report])


if __name__ == "__main__":
    settings = {"mode": "client", "connect": {"endpoints": [sys.argv[1]]}}
    ask = {"modules": [int(sys.argv[2])], "joiner": f"own {sys.argv[2]}", "protocol": 5}
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as opened:
        while True:
            for token in opened.liveliness().get("cubepath/*/alive/coordinator", timeout=2.0):
                run = str(token.ok.key_expr).removesuffix("/alive/coordinator") if token.ok else ""
                for reply in opened.get(f"{run}/orders/any", payload=json.dumps(ask), timeout=2.0):
                    own = Vehicle(opened, run, reply.ok.payload.to_bytes()) if reply.ok else None
                    while own:
                        own.play()
