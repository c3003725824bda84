// The page: two paths beside each other on one time axis, charts below, and what can be asked of it.
(function (cubepath) {
  "use strict";

  const byId = (id) => document.getElementById(id);

  class View {
    /** @param {object} data a document, as docs/viewing.md describes it */
    constructor(data) {
      this.worlds = data.worlds.map((world) => new cubepath.World(world));
      this.paths = data.paths.map((path) => new cubepath.Path(this.worlds[path.world], path));
      this.module = null; // the module that is looked at
      this.pinned = null; // the module that was chosen by a click, until another is
      this.move = null; // the move that is looked at: {path, move}
      this.claims = this.paths.some((path) => path.data.claims);
      this.messages = false;
      this.stages = [];
      this.clock = new cubepath.Clock(0);
      this._head(data);
      data.beside.forEach((number) => this._addStage(this.paths[number] ?? this.paths[0]));
      this.clock = new cubepath.Clock(Math.max(1, ...this.stages.map((stage) => stage.path.steps)));
      const chart = byId("chart");
      this.charts = { schedule: new cubepath.Schedule(chart, this), heap: new cubepath.Heap(chart, this) };
      if (data.complex) this.charts.complex = new cubepath.Complex(chart, this, data.complex);
      this.chart = this.charts.schedule;
      this.inspector = new cubepath.Inspector(this, byId("which"), byId("details"));
      this._options();
      cubepath.addControls(this);
      this._pointing(chart);
      this._watch();
      this.show("schedule");
    }

    _head(data) {
      byId("title").textContent = data.title;
      byId("facts").textContent = data.facts
        .map((facts, each) => (data.names[each] ? `${data.names[each]}: ` : "") + facts.map(([name, value]) => `${name} ${value}`.trim()).join(" · "))
        .join(" — ");
    }

    _addStage(path) {
      const side = this.stages.length;
      const canvas = cubepath.element("canvas", { role: "img", tabindex: "0" });
      const choice = cubepath.element("select", { "aria-label": side ? "Path on the right" : "Path on the left" });
      this.paths.forEach((each, number) => choice.append(cubepath.element("option", { value: String(number) }, each.title)));
      choice.value = String(this.paths.indexOf(path));
      const where = cubepath.element("span", { class: "where" });
      const figure = cubepath.element("figure", { class: "stage" },
        cubepath.element("figcaption", {}, choice, where), cubepath.element("div", { class: "canvas" }, canvas));
      byId("stages").append(figure);
      const stage = new cubepath.Stage(canvas, path, this);
      stage.where = where;
      this.stages.push(stage);
      choice.addEventListener("change", () => {
        stage.show(this.paths[Number(choice.value)]);
        this.fit();
      });
      canvas.addEventListener("pointermove", (event) => this._hover(stage.moduleAt(event.offsetX, event.offsetY), null));
      canvas.addEventListener("pointerleave", () => this._hover(null, null));
      canvas.addEventListener("click", (event) => {
        this.pinned = stage.moduleAt(event.offsetX, event.offsetY);
        this._hover(this.pinned, null);
      });
    }

    /** Look at a module and a move; where there is none, at the module that was chosen. */
    _hover(module, move) {
      const wanted = module ?? this.pinned;
      if (wanted === this.module && move?.move === this.move?.move && move?.path === this.move?.path) return;
      this.module = wanted;
      this.move = move;
      this.changed();
    }

    _options() {
      byId("turning").hidden = !this.worlds.some((world) => world.camera);
      const has = (name) => this.paths.some((path) => path.data[name] && !path.data[name].left_out);
      for (const [name, key] of [["claims", "claims"], ["messages", "heard"]]) {
        byId(name).checked = this[name];
        byId(name).disabled = !has(key);
        byId(name).closest("label").hidden = !has(key);
      }
    }

    _pointing(chart) {
      let seeking = false;
      const go = (event) => {
        const found = this.chart.at(event.offsetX, event.offsetY);
        if (found) {
          this.clock.play(0);
          this.clock.seek(found.t);
        }
        this.changed();
      };
      chart.addEventListener("pointerdown", (event) => {
        if (this.chart === this.charts.complex) return;
        seeking = true;
        chart.setPointerCapture(event.pointerId);
        go(event);
      });
      chart.addEventListener("pointermove", (event) => {
        if (seeking) go(event);
        const found = this.chart.at(event.offsetX, event.offsetY);
        this._hover(found?.module ?? null, found?.move ?? null);
      });
      for (const kind of ["pointerup", "pointercancel"]) chart.addEventListener(kind, () => { seeking = false; });
      chart.addEventListener("pointerleave", () => this._hover(null, null));
    }

    /** Draw anew when the size, the colours or the medium change. */
    _watch() {
      const anew = () => {
        const print = matchMedia("print").matches || this.printing;
        document.documentElement.toggleAttribute("data-print", Boolean(print));
        cubepath.forgetColours();
        this.forget();
      };
      for (const query of ["(prefers-color-scheme: dark)", "print"]) matchMedia(query).addEventListener("change", anew);
      // A page is printed as it is drawn when this event is over, not a frame later.
      addEventListener("beforeprint", () => { this.printing = true; anew(); this.draw(); });
      addEventListener("afterprint", () => { this.printing = false; anew(); });
      new ResizeObserver(() => this.forget()).observe(byId("work"));
      anew();
    }

    /** Forget what was kept of the drawing. */
    forget() {
      for (const part of [...this.stages, ...Object.values(this.charts)]) part.forget();
      cubepath.writeMarks(byId("marks"), this);
      this._legend();
      this.changed();
    }

    /** Fit the time axis to the longer of the two paths. */
    fit() {
      this.clock.steps = Math.max(1, ...this.stages.map((stage) => stage.path.steps));
      byId("time").max = String(this.clock.steps);
      this.clock.seek(this.clock.t);
      this.forget();
    }

    /** See robots in three dimensions from the next side, to the left or to the right. */
    turn(way) {
      this.turned = (this.turned ?? 0) + way;
      for (const world of this.worlds) world.turnTo(this.turned);
      this.forget();
    }

    /** Show a chart by its name. */
    show(name) {
      this.chart = this.charts[name];
      this.chart.forget();
      byId("chart").setAttribute("aria-label", this.chart.said);
      byId("chart").title = this.chart === this.charts.complex ? this.chart.said : "";
      this._legend();
      this.changed();
    }

    _legend() {
      if (!this.chart) return;
      byId("legend").replaceChildren(...this.chart.legend().map(([kind, face, edge, text]) => {
        const swatch = cubepath.element("i", { class: kind });
        swatch.style.setProperty("--swatch", face || "none");
        swatch.style.setProperty("--edge", edge || "transparent");
        swatch.style.borderColor = edge || "transparent";
        return cubepath.element("span", {}, ...(face || edge ? [swatch] : []), text);
      }));
    }

    /** Something is to be drawn with the next frame. */
    changed() {
      if (this.asked) return;
      this.asked = true;
      requestAnimationFrame((now) => this._frame(now));
    }

    _frame(now) {
      this.asked = false;
      const seconds = this.before === undefined ? 0 : Math.min(0.25, (now - this.before) / 1000);
      const playing = this.clock.tick(seconds);
      this.before = this.clock.way ? now : undefined;
      this.draw();
      if (playing || this.clock.way) this.changed();
    }

    /** Draw the moment of the clock. */
    draw() {
      const { clock } = this;
      for (const stage of this.stages) stage.draw(clock.t);
      this.chart.draw();
      this._control();
      // Nobody reads faster than this, and lines of text cost more than modules. All words change
      // together, so that they always name the same step.
      const now = performance.now();
      if (clock.way && now - this.toldAt < 200) return;
      const said = this._say(), told = this.inspector.tell();
      if (said || told) this.toldAt = now;
    }

    /** Show where we are on the slider, and whether it plays. */
    _control() {
      const { clock } = this, time = byId("time");
      if (document.activeElement !== time || Number(time.value) !== clock.t) time.value = String(clock.t);
      byId("speed").textContent = `${clock.speed} ${clock.speed === 1 ? "step" : "steps"}/s`;
      for (const [id, pressed] of [["play", clock.way > 0], ["rewind", clock.way < 0], ["loop", clock.looping]]) {
        byId(id).setAttribute("aria-pressed", String(pressed));
      }
      byId("play").setAttribute("aria-label", clock.way > 0 ? "Pause" : "Play");
    }

    /** Say where we are: next to the pictures, and to screen readers; return whether that is new. */
    _say() {
      const { clock } = this;
      const parts = this.stages.map((stage) => {
        const { path } = stage, step = Math.min(Math.ceil(clock.t - 1e-9), path.steps);
        path.goTo(Math.floor(Math.min(clock.t, path.steps)));
        const end = clock.t >= path.steps ? (path.reached === true ? ", goal" : path.goesOn ? "" : ", end") : "";
        return { path, step, end, canvas: stage.canvas, where: stage.where };
      });
      const last = (path) => path.before + path.steps;
      const said = parts.map(({ path, step, end }) => `${path.label(step)} of ${last(path)}${end}`);
      const words = said.join("; ");
      // While it plays, somebody who listens would hear nothing else.
      if (!clock.way && byId("now").textContent !== words) byId("now").textContent = words;
      if (words === this._saidBefore) return false;
      this._saidBefore = words;
      parts.forEach(({ path, step, end, where, canvas }, each) => {
        where.replaceChildren(`${path.name} `, cubepath.element("b", {}, String(path.before + step)), ` of ${last(path)}${end}`);
        canvas.setAttribute("aria-label", `${path.title}: ${said[each]}`);
      });
      byId("time").setAttribute("aria-valuetext", words);
      return true;
    }
  }

  /** Open a document in this page; docs/viewing.md has its fields. @returns {View} */
  cubepath.open = function (data) {
    byId("stages").replaceChildren();
    cubepath.view = new View(data);
    return cubepath.view;
  };

  /** Where the clock is, in steps. */
  Object.defineProperty(cubepath, "position", { get: () => cubepath.view.clock.t });

  /** Go to a moment, in steps, and pause. */
  cubepath.seek = function (t) {
    cubepath.view.clock.play(0);
    cubepath.view.clock.seek(t);
    cubepath.view.draw();
  };

  /**
   * Where everything is after `t` steps of a path: for each module its site, by name, and where it
   * is drawn, in cells.
   * @param {number} t whole steps; by default where the clock is
   * @param {number} path the number of the path in the document
   */
  cubepath.state = function (t = Math.floor(cubepath.position), path = 0) {
    const shown = cubepath.view.paths[path];
    shown.goTo(t);
    const modules = shown.sites.map((site, module) => {
      const { x, y } = cubepath.poseAt(shown.world, site);
      return { module, site: shown.world.sites.name[site], x, y };
    });
    return { title: shown.title, step: shown.step, steps: shown.steps, reached: shown.reached, modules };
  };

  document.addEventListener("DOMContentLoaded", async () => {
    const data = await cubepath.unpack(byId("data").textContent);
    const view = cubepath.open(data);
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) view.clock.play(1);
    view.changed();
    document.documentElement.dataset.ready = "yes";
  });
})((globalThis.cubepath ??= {}));
