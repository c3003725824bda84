// The state complex of a small system, with both paths in it; dragging turns it.
(function (cubepath) {
  "use strict";

  class Complex {
    constructor(canvas, view, data) {
      this.canvas = canvas;
      this.view = view;
      this.data = data;
      this.angles = data.flat ? [0, 0] : [-0.5, 0.25];
      if (!data.flat) this._drag();
    }

    forget() {}

    draw() {
      const { context, width, height } = cubepath.prepared(this.canvas);
      if (!width || !height) return;
      context.clearRect(0, 0, width, height);
      const spots = this._spots(width, height);
      const { edges, squares } = this.data;
      const line = (...corners) => {
        context.beginPath();
        for (const corner of corners) context.lineTo(...spots[corner]);
      };
      context.fillStyle = cubepath.colour("accent");
      context.globalAlpha = 0.16 / (1 + squares.length / 400);
      for (let each = 0; each < squares.length; each += 4) {
        line(...squares.slice(each, each + 4));
        context.fill();
      }
      context.globalAlpha = 1;
      context.strokeStyle = cubepath.colour("quiet");
      context.globalAlpha = 0.5;
      context.lineWidth = 1;
      for (let each = 0; each < edges.length; each += 2) {
        line(edges[each], edges[each + 1]);
        context.stroke();
      }
      context.globalAlpha = 1;
      context.fillStyle = cubepath.colour("quiet");
      for (const [x, y] of spots) {
        context.beginPath();
        context.arc(x, y, 2, 0, 2 * Math.PI);
        context.fill();
      }
      this._numbers().forEach((number, side) => this._path(context, spots, this.data.paths[number], side));
    }

    _numbers() {
      return this.view.stages.map((stage) => this.view.paths.indexOf(stage.path));
    }

    /** Where the states are seen from here, as large as there is room. */
    _spots(width, height) {
      const [tilt, turn] = this.angles, { points } = this.data;
      const found = [];
      for (let each = 0; each < points.length; each += 3) {
        const [x, y, z] = points.slice(each, each + 3);
        const u = x * Math.cos(turn) + z * Math.sin(turn), w = z * Math.cos(turn) - x * Math.sin(turn);
        found.push([u, w * Math.sin(tilt) - y * Math.cos(tilt)]);
      }
      const least = [0, 1].map((axis) => Math.min(...found.map((spot) => spot[axis])));
      const most = [0, 1].map((axis) => Math.max(...found.map((spot) => spot[axis])));
      const wide = Math.max(most[0] - least[0], 0.01), tall = Math.max(most[1] - least[1], 0.01);
      const scale = Math.min((width - 40) / wide, (height - 28) / tall);
      const at = (spot, axis, size) => size / 2 + scale * (spot[axis] - (least[axis] + most[axis]) / 2);
      return found.map((spot) => [at(spot, 0, width), at(spot, 1, height)]);
    }

    _path(context, spots, path, side) {
      const colour = side ? cubepath.colour("accent") : cubepath.colour("goal");
      context.strokeStyle = colour;
      context.lineWidth = side ? 2 : 3.5;
      context.lineJoin = "round";
      context.globalAlpha = side ? 1 : 0.65;
      context.beginPath();
      for (const state of path) context.lineTo(...spots[state]);
      context.stroke();
      context.globalAlpha = 1;
      const t = Math.min(this.view.clock.t, path.length - 1), step = Math.floor(t);
      const one = spots[path[step]], other = spots[path[Math.min(step + 1, path.length - 1)]];
      const part = cubepath.eased(t - step);
      context.fillStyle = colour;
      context.strokeStyle = cubepath.colour("page");
      context.lineWidth = 2;
      context.beginPath();
      context.arc(one[0] + part * (other[0] - one[0]), one[1] + part * (other[1] - one[1]), 6, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    }

    _drag() {
      let last = null;
      this.canvas.addEventListener("pointerdown", (event) => {
        if (this.view.chart !== this) return;
        last = [event.clientX, event.clientY];
        this.canvas.setPointerCapture(event.pointerId);
      });
      this.canvas.addEventListener("pointermove", (event) => {
        if (!last || this.view.chart !== this) return;
        this.angles[1] += (event.clientX - last[0]) / 150;
        this.angles[0] += (event.clientY - last[1]) / 150;
        last = [event.clientX, event.clientY];
        this.view.changed();
      });
      for (const kind of ["pointerup", "pointercancel"]) this.canvas.addEventListener(kind, () => { last = null; });
    }

    at() {
      return null;
    }

    legend() {
      const [one, other] = this.view.stages.map((stage) => stage.path.title);
      const names = [["vertex", "vertices"], ["edge", "edges"], ["square", "squares"]];
      const counts = Array.from(this.data.counts, (count, k) => `${count} ${(names[k] ?? [`${k}-cube`, `${k}-cubes`])[count === 1 ? 0 : 1]}`).join(", ");
      return [
        ["", "", "", counts],
        ["stroke", "", cubepath.colour("goal"), one],
        ["stroke", "", cubepath.colour("accent"), other],
      ];
    }

    get said() {
      return `State complex with ${this.data.counts[0]} states, and both paths in it${this.data.flat ? "" : "; drag to turn it"}`;
    }
  }

  cubepath.Complex = Complex;
})((globalThis.cubepath ??= {}));
