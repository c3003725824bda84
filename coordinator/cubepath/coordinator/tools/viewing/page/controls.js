// Buttons, keys and the slider.
(function (cubepath) {
  "use strict";

  /** @param {object} view the page, as main.js makes it */
  cubepath.addControls = function (view) {
    const { clock } = view;
    const byId = (id) => document.getElementById(id);
    const time = byId("time");
    time.max = String(clock.steps);

    const step = (way) => {
      clock.play(0);
      clock.seek(way > 0 ? Math.floor(clock.t + 1e-9) + 1 : Math.ceil(clock.t - 1e-9) - 1);
    };
    /** To the next step in which something moves, or the chosen module does. */
    const stepWithMoves = (way) => {
      const own = (path, at) => {
        const count = path.ends[at - 1] - path.begin(at);
        if (view.module === null) return count > 0;
        return path.motions(at).some((each) => each.module === view.module);
      };
      let at = way > 0 ? Math.floor(clock.t + 1e-9) + 1 : Math.ceil(clock.t - 1e-9) - 1;
      const any = () => view.stages.some(({ path }) => at >= 1 && at <= path.steps && own(path, at));
      while (at > 0 && at < clock.steps && !any()) at += way;
      clock.play(0);
      clock.seek(at);
    };
    const play = (way) => clock.play(clock.way === way ? 0 : way);
    const option = (name) => {
      const box = byId(name);
      if (!box.disabled) view[name] = box.checked = !view[name];
    };

    const actions = {
      first: () => { clock.play(0); clock.seek(0); },
      last: () => { clock.play(0); clock.seek(clock.steps); },
      back: () => step(-1),
      forward: () => step(1),
      rewind: () => play(-1),
      play: () => play(1),
      slower: () => clock.faster(-1),
      faster: () => clock.faster(1),
      loop: () => { clock.looping = !clock.looping; if (!clock.looping) clock.loop = null; },
      from: () => clock.bracket("from"),
      until: () => clock.bracket("until"),
      left: () => view.turn(-1),
      right: () => view.turn(1),
    };
    for (const [id, action] of Object.entries(actions)) {
      byId(id).addEventListener("click", () => { action(); view.changed(); });
    }
    for (const name of ["claims", "messages"]) {
      byId(name).addEventListener("change", (event) => { view[name] = event.target.checked; view.changed(); });
    }
    time.addEventListener("input", () => { clock.play(0); clock.seek(Number(time.value)); view.changed(); });

    const keys = {
      " ": () => clock.play(clock.way ? 0 : 1),
      ArrowRight: (shift) => (shift ? stepWithMoves(1) : step(1)),
      ArrowLeft: (shift) => (shift ? stepWithMoves(-1) : step(-1)),
      Home: actions.first, End: actions.last,
      PageUp: () => clock.seek(clock.t - clock.steps / 10), PageDown: () => clock.seek(clock.t + clock.steps / 10),
      "+": actions.faster, "=": actions.faster, "-": actions.slower, "_": actions.slower,
      b: actions.rewind, l: actions.loop, "[": actions.from, "]": actions.until,
      ",": actions.left, ".": actions.right,
      c: () => option("claims"), m: () => option("messages"),
      Escape: () => { view.module = null; view.pinned = null; },
    };
    let typed = "", typedAt = 0;
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
      // Tabs and checkboxes have keys of their own, and a button is pressed by the space bar.
      const role = event.target.getAttribute?.("role");
      if (role === "tab" && /^(Arrow| $)/.test(event.key)) return;
      if (event.key === " " && /^(BUTTON|SUMMARY)$/.test(event.target.tagName)) return;
      if (event.key === " " && event.target.type === "checkbox") return;
      if (/^[0-9]$/.test(event.key)) {
        typed = event.timeStamp - typedAt < 900 ? typed + event.key : event.key;
        typedAt = event.timeStamp;
        const module = Number(typed);
        if (module < view.stages[0].path.world.count) view.module = view.pinned = module;
      } else {
        const action = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
        if (!action) return;
        action(event.shiftKey);
      }
      event.preventDefault();
      view.changed();
    });
    addTabs(view, byId);
  };

  /** Tabs of the charts: the arrows go from one to the next. */
  function addTabs(view, byId) {
    const tabs = Object.keys(view.charts).map((name) => byId(`tab-${name}`));
    const choose = (tab) => {
      view.show(tab.id.slice("tab-".length));
      for (const each of tabs) {
        each.setAttribute("aria-selected", String(each === tab));
        each.tabIndex = each === tab ? 0 : -1;
      }
      byId("panel").setAttribute("aria-labelledby", tab.id);
    };
    tabs.forEach((tab, at) => {
      tab.hidden = false;
      tab.addEventListener("click", () => choose(tab));
      tab.addEventListener("keydown", (event) => {
        const way = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
        if (!way) return;
        const next = tabs[(at + way + tabs.length) % tabs.length];
        choose(next);
        next.focus();
        event.preventDefault();
      });
    });
  }
})((globalThis.cubepath ??= {}));
