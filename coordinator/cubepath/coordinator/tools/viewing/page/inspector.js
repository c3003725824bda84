// What is happening, in words: the moves and claims of a step, or all about one module.
(function (cubepath) {
  "use strict";

  const SHOWN = 14; // more lines than this are counted

  /** An element with attributes and children; texts are texts, whatever is in them. */
  function element(tag, attributes = {}, ...children) {
    const found = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes)) found.setAttribute(name, value);
    found.append(...children);
    return found;
  }

  function chip(path, module, site) {
    const colour = path.world.sites.colour[site] || path.world.modules.colour[module];
    const found = element("span", { class: "chip" }, path.world.modules.word[module]);
    found.style.background = colour;
    found.style.color = cubepath.inkOn(colour);
    return found;
  }

  class Inspector {
    constructor(view, which, details) {
      Object.assign(this, { view, which, details, said: "" });
    }

    /** Tell what is to be told now; return false, and touch nothing, if that is as before. */
    tell() {
      const { view } = this;
      const step = Math.ceil(view.clock.t - 1e-9);
      const looked = view.move ? `${view.paths.indexOf(view.move.path)} ${view.move.move}` : "";
      const key = `${step} ${view.module} ${looked} ${view.stages.map((each) => view.paths.indexOf(each.path))}`;
      if (key === this.said) return false;
      this.said = key;
      const parts = [];
      if (view.module !== null) view.stages.forEach((stage) => this._module(parts, stage.path, view.module, step));
      else view.stages.forEach((stage) => this._step(parts, stage.path, step));
      this.which.textContent = view.module !== null ? `Module ${view.module}` : this._heading(step);
      this.details.replaceChildren(...parts);
      return true;
    }

    /** The step of each side that is not over, as the captions have it: "Round 4, cube 4". */
    _heading(step) {
      const paths = this.view.stages.map((stage) => stage.path);
      const going = paths.filter((path) => step <= path.steps);
      const names = (going.length ? going : paths).map((path) => path.label(Math.min(step, path.steps)));
      const words = [...new Set(names)].join(", ");
      return words[0].toUpperCase() + words.slice(1);
    }

    _step(parts, path, step) {
      parts.push(element("h3", {}, path.title));
      if (step > path.steps) {
        parts.push(element("p", { class: "quiet" }, `over after ${path.label(path.steps)}`));
        return;
      }
      const list = element("ul");
      const begin = step ? path.begin(step) : 0, end = step ? path.ends[step - 1] : 0;
      for (let move = begin; move < Math.min(end, begin + SHOWN); move++) {
        const [[, target]] = path.world.motions(path.rows[move]);
        const words = element("span", {}, path.world.nameOf(path.rows[move]));
        if (path.data.level && path.data.level[move] === 0) words.append(element("span", { class: "quiet" }, " (cancels)"));
        list.append(element("li", {}, chip(path, path.modulesOf(move)[0], target), words));
      }
      if (end - begin > SHOWN) list.append(element("li", { class: "quiet" }, `and ${end - begin - SHOWN} more`));
      if (end === begin) list.append(element("li", { class: "quiet" }, step ? "no move" : "the start"));
      for (const [at, words] of path.data.marks ?? []) {
        if (at === step) parts.push(element("p", { class: "mark" }, words));
      }
      parts.push(list);
      this._claims(parts, path, step);
      this._heard(parts, path, step);
    }

    _claims(parts, path, step) {
      const { claims } = path.data;
      if (!claims || !step) return;
      const begin = step > 1 ? claims.ends[step - 2] : 0, end = claims.ends[step - 1];
      const lost = [];
      for (let each = begin; each < end; each++) if (claims.won[each] === 0) lost.push(each);
      parts.push(element("p", { class: "quiet" }, `${end - begin} ${plural("claim", end - begin)}, ${lost.length} lost`));
      if (!lost.length) return;
      const list = element("ul");
      for (const each of lost.slice(0, SHOWN)) {
        const [[source]] = path.world.motions(claims.row[each]);
        list.append(element("li", {}, chip(path, claims.module[each], source), element("span", {}, `lost ${path.world.nameOf(claims.row[each])}`)));
      }
      parts.push(list);
    }

    _heard(parts, path, step) {
      const { heard } = path.data;
      if (!heard || !step) return;
      if (heard.left_out) {
        parts.push(element("p", { class: "quiet" }, `${heard.left_out} deliveries are too many for a page`));
        return;
      }
      const count = heard.ends[step - 1] - (step > 1 ? heard.ends[step - 2] : 0);
      parts.push(element("p", { class: "quiet" }, `${count} ${plural("message", count)} delivered`));
    }

    _module(parts, path, module, step) {
      if (module >= path.world.count) return;
      const { world } = path;
      const here = Math.floor(this.view.clock.t);
      path.goTo(Math.min(here, path.steps));
      const site = path.sites[module];
      const list = element("dl");
      const say = (name, ...text) => list.append(element("dt", {}, name), element("dd", {}, ...text));
      say("site", world.sites.name[site]);
      if (world.sites.word[site]) say("letter", world.sites.word[site]);
      const moves = path.movesOf[module];
      say("moves", String(moves.length));
      const chosen = this.view.move?.path === path && path.modulesOf(this.view.move.move).includes(module) ? this.view.move.move : null;
      const move = chosen ?? path.lastMove(module, step);
      if (move !== null) this._move(say, path, move, step);
      parts.push(element("h3", {}, path.title), list);
      const lost = this._lost(path, module, step);
      if (lost) parts.push(element("p", { class: "quiet" }, lost));
    }

    _move(say, path, move, step) {
      const { data } = path;
      const at = path.stepOf(move);
      say(at === step ? "makes" : "made", `${path.world.nameOf(path.rows[move])}, ${path.label(at)}`);
      const below = path.below[move];
      say("waited for", below < 0 ? "nobody" : this._named(path, below));
      if (data.level) {
        if (data.level[move]) say("cube", String(data.level[move]));
        else say("cancels with", this._named(path, data.partner[move]));
      }
      if (path.chain.includes(move)) say("", "in the longest chain");
    }

    _named(path, move) {
      const module = path.modulesOf(move)[0];
      return `module ${path.world.modules.word[module]}, ${path.world.nameOf(path.rows[move])}, ${path.label(path.stepOf(move))}`;
    }

    _lost(path, module, step) {
      const { claims } = path.data;
      if (!claims) return "";
      let lost = 0, won = 0;
      const end = step ? claims.ends[Math.min(step, claims.ends.length) - 1] : 0;
      for (let each = 0; each < end; each++) {
        if (claims.module[each] !== module) continue;
        if (claims.won[each] === 0) lost++;
        else won++;
      }
      return `so far ${won} ${plural("claim", won)} granted, ${lost} lost`;
    }
  }

  function plural(name, count) {
    return count === 1 ? name : `${name}s`;
  }

  Object.assign(cubepath, { Inspector, element, plural });
})((globalThis.cubepath ??= {}));
