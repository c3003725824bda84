"""Gathering: from the reports of modules, in any order of arrival, to the edge path of a run.

A round is released when every module has reported it, so the result depends on no clock and no
order of arrival; a report that arrives twice counts once. A report of something that no module can
have done, given where all of them stood, is refused.

`Plausibility` judges what modules send and report. It knows the state at the beginning of the round
and everything sent in it. A message is plausible if it comes from where its module is, and says the
same to every region; a claim must be of an admissible move. A process has finished a phase when its
modules have sent all that is due. When all processes have, verdicts and reports must follow from
the claims and the ranks, which tells a liar from the modules it lied to. When all have reported,
the state advances.
"""

from collections.abc import Callable, Mapping, Sequence

from cubepath.agents.processes.judge import KINDS_IN, RefusedError, refuse
from cubepath.agents.processes.settling import Settling
from cubepath.coordinator.normal_form.compiled_heap import FastHeap
from cubepath.coordinator.runs.edge_path import EdgePath, Gathered, PathDigest, Step
from cubepath.protocol.core.actions import apply_in_place, commute
from cubepath.protocol.core.catalogue import GeneratorPlacement, Move
from cubepath.protocol.core.errors import CheckError, InputError
from cubepath.protocol.core.sites import Site, site_text
from cubepath.protocol.core.system import Scene
from cubepath.protocol.wire import messages as wire
from cubepath.protocol.wire.keys import regions_near


class Plausibility:
    """The state of a run at the beginning of a round, and what was sent and reported in it."""

    def __init__(self, scene: Scene) -> None:
        self.sites: list[Site] = list(scene.start)
        self._system = scene.system
        self._state = set(scene.start_state)
        self._seed = 0
        self._later_seeds: Sequence[tuple[int, int]] = ()
        self._modules_of: Sequence[Sequence[int]] = ()
        self._regions_of = regions_near(scene.system)
        self._round = 0
        self._begin()

    def know(
        self,
        modules_of: Sequence[Sequence[int]],
        seed: int,
        later_seeds: Sequence[tuple[int, int]] = (),
    ) -> None:
        """Know who has which modules, and the seed of the ranks; before anything is checked.

        `later_seeds` are others, each with the first round whose ranks follow it.
        """
        self._modules_of = modules_of
        self._process_of = {
            module: process for process, modules in enumerate(modules_of) for module in modules
        }
        self._seed = seed
        self._later_seeds = later_seeds

    def _begin(self) -> None:
        """Begin a round, in which nothing has been sent."""
        self._round += 1
        self._claims: dict[int, Move] = {}
        self._verdicts: dict[int, bool] = {}
        self._reports: dict[int, wire.Report] = {}
        self._moves: dict[tuple[int, GeneratorPlacement], Move | None] = {}
        self._near: dict[tuple[int, bool], frozenset[str]] = {}
        self._settling: Settling | None = None
        self._phase = ""
        self._begin_phase("join")

    def _begin_phase(self, phase: str) -> None:
        if phase == self._phase:
            return
        self._phase = phase
        self._parts: dict[tuple[type[wire.Part], int], wire.Part] = {}
        self._to: dict[tuple[type[wire.Part], int], set[str]] = {}
        """By kind and module what was sent in this phase, and to which regions."""
        self._counts: dict[int, dict[str, int]] = {}
        self._through: set[int] = set()

    def check(self, message: wire.Message) -> None:
        """Check a message of this round, which comes once, and take it; RefusedError if it cannot.

        That a process is `ready` is checked after everything that it sent in the phase. It must
        have sent everything that was due, and once all are through, verdicts and reports must
        agree.
        """
        match message:
            case wire.Bundle():
                self._begin_phase(message.phase)
                self._check_bundle(message)
                self._take_bundle(message)
            case wire.Reports(parts=reports):
                for report in reports:
                    self._check_report(report)
                self._reports |= {report.module: report for report in reports}
            case wire.Ready(phase=phase):
                self._begin_phase(phase)
                if phase not in KINDS_IN:
                    return
                self._check_through(message)
                self._through.add(message.process)
                if phase == "settle" and len(self._through) == len(self._modules_of):
                    self._check_settled()
            case _:
                pass

    # Outgoing messages.

    def _check_bundle(self, bundle: wire.Bundle) -> None:
        if bundle.process in self._through:
            refuse("contradicts", f"more to {bundle.region} than process_{bundle.process} counted")
        if not bundle.parts:
            refuse("out of place", f"no message goes to {bundle.region}")
        for part in bundle.parts:
            known = self._parts.get((type(part), part.module))
            if known is None:
                self._check_part(part)
            elif known != part:
                refuse("contradicts", f"{_to(part, bundle)}: it was another elsewhere")
            elif bundle.region in self._to[type(part), part.module]:
                refuse("doubled", f"{_to(part, bundle)} came before")
            if bundle.region not in self._regions(part):
                refuse("out of place", f"{_to(part, bundle)}: no module is there to receive it")

    def _check_part(self, part: wire.Part) -> None:
        """Check what a module says, apart from where it goes."""
        if self.sites[part.module] != part.site:
            refuse("impossible", self._elsewhere(wire.kind_of(part), part.module, part.site))
        match part:
            case wire.Claim(generator=generator, at=at):
                move = self._move(part.module, GeneratorPlacement(generator, at))
                if move is None or not move.possible(self._state):
                    where = f"claim of module_{part.module}: {generator} at {site_text(at)}"
                    refuse("impossible", f"{where} is not admissible")
            case wire.Verdict():
                self._check_verdict(part)
            case _:
                pass

    def _check_verdict(self, verdict: wire.Verdict) -> None:
        name = f"verdict of module_{verdict.module}"
        if verdict.module not in self._claims:
            refuse("impossible", f"{name}, which claims nothing")
        due = self._waiting_for(verdict.module)
        if set(verdict.to) != due:
            refuse("impossible", f"{name}: it goes to modules other than those that wait for it")

    def _take_bundle(self, bundle: wire.Bundle) -> None:
        counts = self._counts.setdefault(bundle.process, {})
        counts[bundle.region] = counts.get(bundle.region, 0) + 1
        for part in bundle.parts:
            key = type(part), part.module
            if key in self._parts:
                self._to[key].add(bundle.region)
                continue
            self._parts[key] = part
            self._to[key] = {bundle.region}
            match part:
                case wire.Claim(generator=generator, at=at):
                    move = self._move(part.module, GeneratorPlacement(generator, at))
                    if move is not None:
                        self._claims[part.module] = move
                case wire.Verdict(granted=granted):
                    self._verdicts[part.module] = granted
                case _:
                    pass

    def _regions(self, part: wire.Part) -> frozenset[str]:
        """Return the regions that a part goes to."""
        if isinstance(part, wire.Verdict):
            return frozenset(self._system.region(place) for place in part.to)
        return self._regions_from(part.module, sensed=type(part) is wire.Presence)

    def _regions_from(self, module: int, *, sensed: bool) -> frozenset[str]:
        """Return the regions that a module speaks to in this round."""
        found = self._near.get((module, sensed))
        if found is None:
            found = self._near[module, sensed] = self._regions_of(self._place(module), sensed)
        return found

    def _place(self, module: int) -> Site:
        return self._system.place_of(self.sites[module])

    # What is due.

    def _check_through(self, ready: wire.Ready) -> None:
        process = ready.process
        counted = {region: count for region, count in ready.sent.items() if count}
        if self._counts.get(process, {}) != counted:
            refuse("contradicts", f"process_{process} counts other messages than it said")
        for module in self._modules_of[process]:
            for kind in KINDS_IN[ready.phase]:
                part = self._parts.get((kind, module))
                if part is None:
                    self._check_silent(kind, module)
                # It went to no other region than those, and to each once.
                elif len(self._to[kind, module]) < len(self._regions(part)):
                    missing = min(self._regions(part) - self._to[kind, module])
                    refuse(
                        "contradicts", f"no {wire.kind_of(part)} of module_{module} to {missing}"
                    )

    def _check_silent(self, kind: type[wire.Part], module: int) -> None:
        """Check that nobody waits for what a module does not say."""
        if kind is wire.Presence and self._regions_from(module, sensed=True):
            refuse("contradicts", f"module_{module} does not say that it is here")
        if kind is wire.Verdict and module in self._claims and self._waiting_for(module):
            refuse("contradicts", f"no verdict of module_{module}, and others wait for it")

    def _waiting_for(self, module: int) -> set[Site]:
        if self._settling is None:
            self._settling = self._settled()
        return {self._system.place_of(site) for site in self._settling.waiting[module]}

    def _settled(self) -> Settling:
        return Settling(
            self._claims, seed=self._seed, round_number=self._round, later_seeds=self._later_seeds
        )

    def _check_settled(self) -> None:
        sites = dict(enumerate(self.sites))
        # Anew: moves of modules out of everybody's reach are known only from their reports.
        settling = self._settled()
        fault = settling.fault(self._verdicts, self._reports, sites)
        if fault is not None:
            module, why = fault
            raise RefusedError("impossible", why, self._process_of[module])

    def _elsewhere(self, kind: str, module: int, site: object) -> str:
        there = site_text(self.sites[module])
        return f"{kind} of module_{module} from {site_text(site)}: it is at {there}"

    def _move(self, module: int, placed: GeneratorPlacement) -> Move | None:
        """Return the move of a module by its name, None if there is none."""
        key = module, placed
        if key not in self._moves:
            try:
                self._moves[key] = self._found(self.sites[module], placed)
            except (InputError, TypeError):
                self._moves[key] = None
        return self._moves[key]

    def _found(self, site: Site, placed: GeneratorPlacement) -> Move | None:
        at = placed.at
        move = self._system.move_named(site, placed.generator, at)
        if move is not None:
            return move
        action = self._system.action(placed.generator, at)  # it may have other names
        return next((move for move in self._system.moves_at(site) if move.action == action), None)

    def _check_report(self, report: wire.Report) -> None:
        module = report.module
        name = f"report of module_{module}"
        if self.sites[module] != report.before:
            refuse("impossible", self._elsewhere("report", module, report.before))
        if (report.move is not None) != (report.claim == "granted"):
            refuse(
                "impossible", f"{name}: a claim that is {report.claim}, and a move {report.move}"
            )
        if (report.claim == "none") == (module in self._claims) and self._is_heard(module):
            refuse("impossible", f"{name}: its claim is {report.claim}")
        if report.move is not None:
            self._check_move(
                f"{name}: {report.move.generator} at {site_text(report.move.at)}", report
            )
        # Most stay where they are, and all claims are looked through only for the others.
        elif report.site != report.before and report.site not in self._taken_to(module):
            refuse(
                "impossible", f"{name}: it ends at {site_text(report.site)}, where nothing takes it"
            )

    def _check_move(self, name: str, report: wire.Report) -> None:
        module = report.module
        move = None if report.move is None else self._move(module, report.move)
        if move is None:
            refuse("impossible", f"{name} is no move from {site_text(self.sites[module])}")
        if report.site != move.target:
            refuse("impossible", f"{name} does not end at {site_text(report.site)}")
        if not self._is_heard(module):
            self._claims[module] = move
        elif self._claims.get(module) != move:
            refuse("impossible", f"{name} was not claimed")
        if not move.possible(self._state):
            refuse("impossible", f"{name} is not admissible")

    def _taken_to(self, module: int) -> set[Site]:
        """Return where others may take a module that made no move."""
        return {
            target
            for move in self._claims.values()
            for source, target in move.motion[1:]
            if source == self.sites[module]
        }

    def _is_heard(self, module: int) -> bool:
        """Return whether a claim of a module goes to any place, and so comes here."""
        return bool(self._system.reach(self._place(module)))

    # The end of a round.

    def carry_out(self, reports: Mapping[int, wire.Report]) -> None:
        """End the round: make the moves reported; CheckError names a report that cannot be.

        The claims of modules need not be known.
        """
        after = dict(enumerate(self.sites))
        made: dict[int, Move] = {}
        for module, report in reports.items():
            if report.before != self.sites[module]:
                raise CheckError(self._elsewhere("report", module, report.before))
            if report.move is None:
                continue
            move = self._move(module, report.move)
            at = site_text(report.move.at)
            where = f"report of module_{module}: {report.move.generator} at {at}"
            if move is None:
                raise CheckError(f"{where} is no move from {site_text(self.sites[module])}")
            if not move.possible(self._state):
                raise CheckError(f"{where} is not admissible")
            made[module] = move
        self._make(made, after)
        for module, report in reports.items():
            if after[module] != report.site:
                raise CheckError(
                    f"report of module_{module}: it ends at {site_text(report.site)}, and the moves"
                    f" take it to {site_text(after[module])}"
                )
        self.sites = [after[module] for module in range(len(self.sites))]
        self._begin()

    def _make(self, moves: Mapping[int, Move], after: dict[int, Site]) -> None:
        standing = {site: module for module, site in after.items()}
        over: dict[Site, list[int]] = {}
        for module, move in moves.items():
            near = {other for site in move.action.support for other in over.get(site, ())}
            for other in sorted(near):
                if not commute(move.action, moves[other].action):
                    raise CheckError(
                        f"report of module_{module}: its move does not commute with that of"
                        f" module_{other}"
                    )
            for site in move.action.support:
                over.setdefault(site, []).append(module)
            try:
                apply_in_place(move.action, self._state)
            except InputError as error:
                raise CheckError(f"report of module_{module}: {error}") from None
            for source, target in move.motion:
                if source in standing:
                    after[standing[source]] = target


def _to(part: wire.Part, bundle: wire.Bundle) -> str:
    return f"{wire.kind_of(part)} of module_{part.module} to {bundle.region}"


class Gatherer(Gathered):
    """Gathers reports into the edge path and keeps its normal cube path as moves come in.

    Each complete round is passed to `watch` as a `Step`. The moves of a round commute, so their
    order within the round does not change the homotopy class of the path.
    """

    def __init__(self, scene: Scene, watch: Callable[[Step], None] | None = None) -> None:
        self.scene = scene
        self._heap = FastHeap(telling=True)
        self._path = EdgePath(scene)
        self.sites = list(scene.start)
        self._digest = PathDigest()
        self._watch = watch
        self._waiting: dict[int, dict[int, wire.Report]] = {}
        self.plausibility = Plausibility(scene)

    @property
    def _edges(self) -> EdgePath:
        return self._path

    @property
    def heap(self) -> FastHeap:
        """Return the heap of the moves so far; they are added to it only when it is asked for."""
        actions, names = self._path.actions, self._path.names
        self._heap.extend(actions[names[place]] for place in range(self._heap.moves, len(names)))
        return self._heap

    @property
    def digest(self) -> str:
        """Return the digest of the edge path so far."""
        return self._digest.text()

    @property
    def failed(self) -> str | None:
        """Return which module gave up in the last round, and why; None if none did."""
        for module, reason in self._path.failures.get(self.rounds - 1, ()):
            return f"module_{module}: {reason}"
        return None

    @property
    def begun(self) -> int:
        """Return the last round for which any report has arrived."""
        return max(self._waiting, default=self.rounds)

    @property
    def unfinished(self) -> str | None:
        """Return which round is not complete although a later one was begun; None if none is."""
        if self.begun <= self.rounds + 1:
            return None
        return (
            f"round {self.rounds + 1} is not complete, but there are reports of round"
            f" {self.begun}: expected all rounds up to the last"
        )

    @property
    def ahead(self) -> int | None:
        """Return the first round that is whole although the one before it is not; None if none."""
        if self.begun <= self.rounds + 1:
            return None
        whole = (n for n, each in self._waiting.items() if len(each) == len(self.sites))
        return min(whole, default=None)

    def waiting(self) -> list[wire.Report]:
        """Return the reports of the rounds that are not released yet, in the order of rounds."""
        rounds = (reports for _, reports in sorted(self._waiting.items()))
        return [reports[module] for reports in rounds for module in sorted(reports)]

    def receive(self, report: wire.Report) -> None:
        """Take a report; CheckError if two differ, or if it cannot be."""
        if not 0 <= report.module < len(self.sites):
            raise CheckError(f"a report of module_{report.module}: no such module in this run")
        if report.round <= self.rounds:
            return  # a report of this round was released already
        reports = self._waiting.setdefault(report.round, {})
        known = reports.setdefault(report.module, report)
        if known != report:
            raise CheckError(
                f"module_{report.module} reports round {report.round} twice, and differently"
            )
        while len(self._waiting.get(self.rounds + 1, ())) == len(self.sites):
            self._release(self._waiting.pop(self.rounds + 1))

    def _release(self, reports: dict[int, wire.Report]) -> None:
        path = self._path
        executed: list[wire.Executed] = []
        names: list[int] = []
        failures: list[tuple[int, str]] = []
        self.plausibility.carry_out(reports)
        for module in sorted(reports):
            report = reports[module]
            self.sites[module] = self.plausibility.sites[module]
            if report.failed is not None:
                failures.append((module, report.failed))
            if report.move is not None:
                executed.append(wire.Executed(module, report.move.generator, report.move.at))
                names.append(path.name(report.move))
        self._digest.add(self.rounds + 1, executed)
        if failures:
            path.failures[self.rounds] = tuple(failures)
        path.movers.extend(move.module for move in executed)
        path.names.extend(names)
        path.ends.append(len(path.names))
        if self._watch is not None:
            self._watch(path.step(self.rounds - 1))
