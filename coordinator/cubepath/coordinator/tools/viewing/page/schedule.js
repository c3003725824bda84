// The schedule: a lane for each module, in its upper half the one path and in its lower the other.
(function (cubepath) {
  "use strict";

  class Schedule extends cubepath.Chart {
    _look(context) {
      if (this.view.module !== null && this.view.module < this.lanes.count) {
        context.strokeStyle = cubepath.colour("accent");
        context.lineWidth = 1;
        context.strokeRect(this.lanes.x(0) - 0.5, this.lanes.y(this.view.module), this.lanes.wide + 1, this.lanes.lane);
      }
      this._linked(context);
    }

    _prepare(context, width, height) {
      const paths = this.view.stages.map((stage) => stage.path);
      const count = Math.max(...paths.map((path) => path.world.count));
      this.lanes = new cubepath.Lanes(width, height, this.view.clock.steps, count);
      const steps = paths.every((path) => path.name === paths[0].name) ? paths[0].name : "step";
      this.lanes.ground(context, (lane) => paths[0].world.modules.word[lane] ?? String(lane), { lane: "module", step: steps });
      paths.forEach((path, half) => this._path(context, path, half));
      paths.forEach((path, half) => this._end(context, path, half));
      for (const { step } of cubepath.marksOf(paths)) this.lanes.mark(context, step);
    }

    /** Draw the boxes of a path in a half of the lanes, one colour after another. */
    _path(context, path, half) {
      const groups = new Map();
      for (let step = 1; step <= path.steps; step++) {
        for (let move = path.begin(step); move < path.ends[step - 1]; move++) {
          path.world.motions(path.rows[move]).forEach(([, target], each) => {
            const module = path.by[path.firstBy[move] + each];
            const colour = path.world.sites.colour[target] || path.world.modules.colour[module];
            const gone = path.data.level && path.data.level[move] === 0;
            const key = gone ? "gone" : colour;
            if (!groups.has(key)) groups.set(key, []);
            groups.get(key).push(step, module);
          });
        }
      }
      for (const [colour, boxes] of groups) {
        context.fillStyle = colour === "gone" ? cubepath.colour("page") : colour;
        if (path.data.level && colour !== "gone") context.fillStyle = cubepath.faint(colour, 0.55);
        context.strokeStyle = colour === "gone" ? cubepath.colour("quiet") : cubepath.colour("rule");
        context.lineWidth = 0.8;
        context.beginPath();
        for (let each = 0; each < boxes.length; each += 2) context.rect(...this._box(boxes[each], boxes[each + 1], half));
        context.fill();
        if (this.lanes.step > 3 && this.lanes.lane > 5) context.stroke();
      }
    }

    _box(step, module, half) {
      const { lanes } = this;
      const gap = Math.min(1, lanes.step * 0.08), edge = Math.min(1.5, lanes.lane * 0.06);
      const tall = lanes.lane / 2 - edge;
      const top = lanes.y(module) + (half ? lanes.lane / 2 + edge * 0.3 : edge * 0.7);
      return [lanes.x(step - 1) + gap, top, Math.max(1, lanes.step - 2 * gap), Math.max(0.5, tall)];
    }

    /** A line where a path ends. */
    _end(context, path, half) {
      const { lanes } = this, x = lanes.x(path.steps);
      context.strokeStyle = cubepath.colour("ink");
      context.lineWidth = 1;
      context.setLineDash(half ? [] : [2, 3]);
      context.beginPath();
      context.moveTo(x, lanes.y(0));
      context.lineTo(x, lanes.y(lanes.count));
      context.stroke();
      context.setLineDash([]);
    }

    /** Around the move that is looked at, and lines to what it waited for and cancels with. */
    _linked(context) {
      const looked = this.view.move;
      if (!looked) return;
      const half = this.view.stages.findIndex((stage) => stage.path === looked.path);
      if (half < 0) return;
      const { path, move } = looked;
      const box = (each) => this._box(path.stepOf(each), path.modulesOf(each)[0], half);
      const middle = ([x, y, wide, tall]) => [x + wide / 2, y + tall / 2];
      context.lineWidth = 2;
      context.strokeStyle = cubepath.colour("ink");
      context.strokeRect(...box(move));
      const others = [[path.below[move], []], [path.data.partner ? path.data.partner[move] : -1, [3, 3]]];
      for (const [other, dashes] of others) {
        if (other < 0) continue;
        context.setLineDash(dashes);
        context.beginPath();
        context.moveTo(...middle(box(move)));
        context.lineTo(...middle(box(other)));
        context.stroke();
        context.setLineDash([]);
        context.strokeRect(...box(other));
      }
    }

    /** What lies at a point: the time, the module and the move, if there is one. */
    at(x, y) {
      const found = this.lanes?.at(x, y);
      if (!found) return null;
      const half = (y - this.lanes.y(found.lane)) * 2 < this.lanes.lane ? 0 : 1;
      const path = this.view.stages[half].path;
      const step = Math.floor(found.t) + 1;
      let move = null;
      const last = found.lane < path.world.count ? path.lastMove(found.lane, step) : null;
      if (last !== null && path.stepOf(last) === step) move = { path, move: last };
      return { t: found.t, module: found.lane, move };
    }

    /** The entries of the legend: [class, face, edge, text]. */
    legend() {
      const [one, other] = this.view.stages.map((stage) => stage.path);
      const ink = cubepath.colour("quiet");
      const pale = cubepath.faint("#59606a", 0.55);
      const entries = [
        ["", one.data.level ? pale : "#59606a", "", `above: ${one.title}`],
        ["", other.data.level ? pale : "#59606a", "", `below: ${other.title}`],
      ];
      const cancels = (path) => path.data.level && Array.from(path.data.level).includes(0);
      if (cancels(one) || cancels(other)) entries.push(["", "", ink, "cancels with another"]);
      return entries;
    }

    get said() {
      const [one, other] = this.view.stages.map((stage) => stage.path);
      return `Schedule: a lane for each module; above ${one.title}, ${one.steps} steps; below ${other.title}, ${other.steps} steps`;
    }
  }

  cubepath.Schedule = Schedule;
})((globalThis.cubepath ??= {}));
