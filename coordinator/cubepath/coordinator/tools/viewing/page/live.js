// A live run: steps come in, the newest is shown, and the run can be paused or stepped.
(function (cubepath) {
  "use strict";

  const byId = (id) => document.getElementById(id);
  const SECONDS = 1; // within which the newest step is shown, however many have come
  const FASTEST = 1024; // steps a second
  const pristine = document.documentElement.cloneNode(true);
  const open = cubepath.open;
  let live = null;

  /** Open the document, whose lists grow from now on, and follow the run. */
  cubepath.open = function (data) {
    const view = open(data);
    live = new Live(view, data);
    cubepath.live = live;
    return view;
  };

  class Live {
    constructor(view, data) {
      this.view = view;
      this.data = data;
      for (const path of view.paths) path.goesOn = true;
      this.waiting = [];
      this.said = { claims: [], heard: [] }; // what was said in each step, three numbers an entry
      this.stale = Infinity; // the first step of which something was said anew
      this.state = null;
      this.ending = null;
      this._bar();
      // The newest step is shown where the clock is: at the start there is none.
      view.clock.t = 0;
      // It reconnects by itself when the connection is lost, and continues after the last step.
      const source = new EventSource("events");
      this.connected = true;
      for (const kind of ["steps", "said", "schedule", "state", "end"]) {
        source.addEventListener(kind, (event) => this._heard(kind, JSON.parse(event.data)));
      }
      source.addEventListener("open", () => {
        this.connected = true;
        this._say();
      });
      source.addEventListener("error", () => {
        this.connected = false;
        if (this.ending) source.close();
        this._say();
      });
      this.source = source;
      this._say();
    }

    _bar() {
      const button = (id, text, title) => cubepath.element("button", { type: "button", id, title }, text);
      this.line = cubepath.element("p", { id: "live-said", role: "status", "aria-live": "polite" });
      this.newest = button("live-newest", "newest", "Show the newest step, and follow the run (N)");
      this.pause = button("live-pause", "pause run", "Let the run wait before its next round (P)");
      this.step = button("live-step", "step run", "Let the run play one round, and wait (S)");
      this.rate = cubepath.element("select", { id: "live-rate", "aria-label": "Rounds a second at most" },
        ...["", "0.5", "1", "2", "5", "10", "20", "50"].map((rate) =>
          cubepath.element("option", { value: rate }, rate ? `${rate} rounds/s` : "full speed")));
      this.keep = button("live-save", "save", "Save this page with all steps so far, to be opened without a network");
      const group = cubepath.element("div", { class: "group" }, this.newest, this.pause, this.step, this.rate, this.keep);
      byId("player").append(cubepath.element("div", { class: "row", id: "live" }, group, this.line));
      this.newest.addEventListener("click", () => this.goToNewest());
      this.pause.addEventListener("click", () => this.order(this.state?.paused ? "resume" : "pause"));
      this.step.addEventListener("click", () => this.order("step"));
      this.rate.addEventListener("change", () => this.order("rate", this.rate.value ? Number(this.rate.value) : null));
      this.keep.addEventListener("click", () => this.save());
      const keys = { n: this.newest, p: this.pause, s: this.step };
      addEventListener("keydown", (event) => {
        if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
        const pressed = keys[event.key.toLowerCase()];
        if (!pressed || pressed.disabled || pressed.hidden) return;
        pressed.click();
        event.preventDefault();
      });
      const list = byId("keys").querySelector("dl");
      for (const [key, what] of [["N", "the newest step"], ["P", "pause the run, and resume it"], ["S", "a round of the run"]]) {
        list.append(cubepath.element("dt", {}, cubepath.element("kbd", {}, key)), cubepath.element("dd", {}, what));
      }
    }

    /** The steps so far, as the run made them. */
    get path() {
      return this.view.paths[0];
    }

    /** Tell the run something; what it refuses is shown. */
    async order(order, value = null) {
      try {
        const answer = await fetch("orders", {
          method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify({ order, value }),
        });
        this.refused = answer.ok ? "" : (await answer.text()).trim();
      } catch {
        this.refused = "the run cannot be reached";
      }
      this._say();
    }

    _heard(kind, told) {
      this.waiting.push({ kind, told });
      this._later();
    }

    /** Take what came all at once, and not again before as much time has gone by. */
    _later() {
      if (this.asked) return;
      this.asked = setTimeout(() => {
        const begun = performance.now();
        this.asked = null;
        this._take();
        this.pauseMs = Math.min(500, performance.now() - begun);
      }, this.pauseMs ?? 0);
    }

    _take() {
      const { view, path } = this, { clock } = view;
      const follows = clock.way > 0 || clock.t >= path.steps;
      clock.t = Math.min(clock.t, path.steps);
      const waiting = this.waiting;
      this.waiting = [];
      for (const { kind, told } of waiting) {
        if (kind === "steps") this._steps(told);
        else if (kind === "said") this._said(told);
        else if (kind === "schedule") this._schedule(told);
        else if (kind === "state") this._paced(told);
        else this._end(told);
      }
      this._arrange();
      view.inspector.said = "";
      view.fit();
      const left = path.steps - clock.t;
      if (follows && left > 0 && !clock.looping) {
        const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
        if (still || left > FASTEST) clock.t = path.steps;
        else {
          clock.way = 1;
          clock.speed = Math.max(1, 2 ** Math.ceil(Math.log2(left / SECONDS)));
        }
      }
      view.changed();
      this._say();
    }

    _steps({ from, before, world, rows, states }) {
      this.path.before = before;
      if (world) grow(this.path.world, world);
      if (from < this.path.steps) truncate(this.path, from);
      this.stale = Math.min(this.stale, from + 1);
      if (states) this.data.complex.paths[0].splice(from + 1, Infinity, ...states);
      const { path } = this;
      for (const step of rows) {
        // What they wait for, and cancel with, is known when the schedule of these moves comes.
        path.append({ rows: step, below: step.map(() => -1), depth: step.map(() => path.steps + 1) });
        path.data.partner.push(...step.map(() => -1));
        path.data.level.push(...step.map(() => 1));
      }
    }

    _said({ world, claims, heard, kinds, left_out, dropped }) {
      if (world) grow(this.path.world, world);
      const { said, path } = this;
      for (const [all, some] of [[said.claims, claims], [said.heard, heard ?? []]]) {
        for (const [step, entries] of some) {
          all[step] = entries;
          this.stale = Math.min(this.stale, step);
        }
      }
      this.dropped = dropped;
      if (kinds) path.data.heard.kinds = kinds;
      if (left_out) {
        path.data.heard = { left_out };
        said.heard = [];
        this.view.messages = false;
        this.view._options();
      }
    }

    /** Put what was said in each step into the tables of the path, from the first on that is new. */
    _arrange() {
      const { claims, heard } = this.path.data;
      put(claims, ["module", "row", "won"], this.said.claims, this.stale, this.path.steps);
      if (heard?.ends) put(heard, ["kind", "from", "to"], this.said.heard, this.stale, this.path.steps);
      this.stale = Infinity;
    }

    _schedule({ normal, states, ...told }) {
      const { path, view } = this;
      if (states) this.data.complex.paths[1] = states;
      for (const [of, key] of listsOf(path)) {
        told[key].slice(0, path.rows.length).forEach((value, move) => { of[key][move] = value; });
      }
      path._chain = undefined;
      const before = view.paths[1];
      const after = new cubepath.Path(before.world, { ...before.data, ...normal });
      after.goesOn = true;
      view.paths[1] = after;
      for (const stage of view.stages) if (stage.path === before) stage.show(after);
      if (view.move?.path === before) view.move = null;
    }

    _paced(state) {
      this.state = state;
      this.rate.value = state.rate === null ? "" : String(state.rate);
      if (this.rate.selectedIndex < 0) {
        this.rate.append(cubepath.element("option", { value: String(state.rate) }, `${state.rate} rounds/s`));
        this.rate.value = String(state.rate);
      }
    }

    _end(ending) {
      this.ending = ending;
      for (const path of this.view.paths) path.goesOn = false;
      this.source.close();
      this.connected = false;
    }

    /** Show the newest step from now on. */
    goToNewest() {
      const { clock } = this.view;
      clock.looping = false;
      clock.play(0);
      clock.seek(this.path.steps);
      this.view.changed();
    }

    _say() {
      const { state, ending } = this;
      const round = this.path.label(this.path.steps);
      const how = { goal: "goal reached", "max-rounds": "as many rounds as it may have" };
      let said = `${round}: goes on`;
      if (ending) said = `ended in ${round}: ${ending.error ?? how[ending.ended] ?? ending.ended}`;
      else if (!this.connected) said = `${round}: waiting for whoever feeds this page`;
      else if (state?.paused && !state.steps) said = `${round}: paused`;
      if (this.dropped) said += ` (${this.dropped} messages were too many to be shown)`;
      if (this.refused) said += ` (${this.refused})`;
      if (this.line.textContent !== said) this.line.textContent = said;
      const controlled = Boolean(state) && !ending;
      for (const each of [this.pause, this.step, this.rate]) {
        each.hidden = !state;
        each.disabled = !controlled || !this.connected;
      }
      this.pause.textContent = state?.paused ? "resume run" : "pause run";
      this.pause.setAttribute("aria-pressed", String(Boolean(state?.paused)));
    }

    /** The page with all that it shows, as a text that needs nobody who feeds it. */
    async saved() {
      const { view, data } = this;
      const paths = view.paths.map((path) => {
        const { before, ends, rows, below, depth } = path;
        return { ...path.data, ...(before && { before }), ends, rows, below, depth };
      });
      const worlds = data.worlds.map((world, number) =>
        Object.fromEntries(Object.keys(world).map((key) => [key, view.worlds[number][key]])));
      const page = pristine.cloneNode(true);
      page.querySelector("script[data-live]").remove();
      const policy = page.querySelector('meta[name="saved-policy"]');
      policy.removeAttribute("name");
      policy.setAttribute("http-equiv", "Content-Security-Policy");
      page.querySelector("#data").textContent = await cubepath.pack({ ...data, worlds, paths });
      return `<!doctype html>\n${page.outerHTML}\n`;
    }

    async save() {
      const link = cubepath.element("a", {
        href: URL.createObjectURL(new Blob([await this.saved()], { type: "text/html" })), download: "run.html",
      });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 60000);
    }
  }

  /** Take what has come to a world. */
  function grow(world, { sites, rows, ...frame }) {
    world.extend({ sites, rows });
    Object.assign(world, frame);
  }

  /** Fill the columns of a table from a step on, up to the last. */
  function put(table, names, steps, from, last) {
    if (from > last) return;
    table.ends.length = Math.min(table.ends.length, from - 1);
    for (const name of names) table[name].length = table.ends.at(-1) ?? 0;
    for (let step = table.ends.length + 1; step <= last; step++) {
      const entries = steps[step] ?? [];
      for (let each = 0; each < entries.length; each++) table[names[each % names.length]].push(entries[each]);
      table.ends.push(table[names[0]].length);
    }
  }

  /** The lists of a path that have an entry for each move, by whose they are. */
  function listsOf(path) {
    return [[path, "below"], [path, "depth"], [path.data, "partner"], [path.data, "level"]];
  }

  /** Take back the steps of a path after the first `count`. */
  function truncate(path, steps) {
    path.goTo(steps);
    const moves = path.begin(steps + 1);
    for (const own of path.movesOf) while (own.length && own.at(-1) >= moves) own.pop();
    path.ends.length = steps;
    path.rows.length = moves;
    path.by.length = path.firstBy[moves];
    path.firstBy.length = moves + 1;
    for (const [of, key] of listsOf(path)) of[key].length = moves;
    path._chain = undefined;
    path.largest = 0;
    for (let step = 1; step <= steps; step++) path.largest = Math.max(path.largest, path.ends[step - 1] - path.begin(step));
  }
})((globalThis.cubepath ??= {}));
