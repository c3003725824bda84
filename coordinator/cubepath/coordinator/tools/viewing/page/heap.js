// The heap of pieces: time from left to right, sites from top to bottom, the longest chain marked.
(function (cubepath) {
  "use strict";

  class Heap extends cubepath.Chart {
    /** The path whose heap is shown: that of the right side. */
    get path() {
      return this.view.stages[1].path;
    }

    _look(context) {
      const looked = this.view.move;
      if (looked?.path === this.path) this._outline(context, looked.move, 2);
    }

    /** Put the sites into lanes: those that share moves near each other, along the longer side. */
    _order() {
      const { path } = this, { at, to } = path.world.sites;
      const used = new Set();
      for (const row of new Set(path.rows)) for (const [source, target] of path.world.motions(row)) used.add(source).add(target);
      const sites = [...used], spots = sites.map((site) => [(at[2 * site] + to[2 * site]) / 2, (at[2 * site + 1] + to[2 * site + 1]) / 2]);
      const spread = (axis) => Math.max(...spots.map((spot) => spot[axis]), 0) - Math.min(...spots.map((spot) => spot[axis]), 0);
      const main = spread(0) >= spread(1) ? 0 : 1;
      const order = sites.map((_, each) => each).sort((one, other) =>
        spots[one][main] - spots[other][main] || spots[one][1 - main] - spots[other][1 - main] || sites[one] - sites[other]);
      return order.map((each) => sites[each]);
    }

    _prepare(context, width, height) {
      const { path } = this;
      const order = this._order();
      this.laneOf = new Map(order.map((site, lane) => [site, lane]));
      this.lanes = new cubepath.Lanes(width, height, this.view.clock.steps, Math.max(1, order.length));
      this.lanes.ground(context, (lane) => order.length ? path.world.sites.name[order[lane]].replaceAll(" ", "") : "", { lane: "site", step: path.name === "cube" ? "cube" : "depth" });
      for (let move = 0; move < path.rows.length; move++) this._piece(context, move);
      this._chain(context);
    }

    /** The column of a move: its depth in the heap, which in a normal cube path is its cube. */
    _span(move) {
      const lanes = this.path.world.motions(this.path.rows[move]).flatMap(([source, target]) => [this.laneOf.get(source), this.laneOf.get(target)]);
      return [this.path.depth[move], Math.min(...lanes), Math.max(...lanes), lanes];
    }

    _piece(context, move) {
      const { lanes, path } = this;
      const [depth, low, high, touched] = this._span(move);
      const module = path.by[path.firstBy[move]];
      const [, target] = path.world.motions(path.rows[move])[0];
      const colour = path.world.sites.colour[target] || path.world.modules.colour[module];
      const wide = Math.max(1, Math.min(lanes.step - 2, 22)), x = lanes.x(depth - 0.5);
      context.fillStyle = cubepath.faint(colour, 0.3);
      context.fillRect(x - wide / 2, lanes.y(low) + 0.5, wide, (high - low + 1) * lanes.lane - 1);
      context.fillStyle = colour;
      for (const lane of touched) context.fillRect(x - wide / 2, lanes.y(lane) + 0.5, wide, Math.max(1, lanes.lane - 1));
    }

    _outline(context, move, width) {
      const { lanes } = this;
      const [depth, low, high] = this._span(move);
      const wide = Math.max(2, Math.min(lanes.step - 2, 22));
      context.strokeStyle = cubepath.colour("chain");
      context.lineWidth = width;
      context.strokeRect(lanes.x(depth - 0.5) - wide / 2, lanes.y(low), wide, (high - low + 1) * lanes.lane);
    }

    _chain(context) {
      const { lanes } = this, chain = this.path.chain;
      context.strokeStyle = cubepath.colour("chain");
      context.lineWidth = 1.6;
      context.lineJoin = "round";
      context.beginPath();
      for (const move of chain) {
        const [depth, low, high] = this._span(move);
        context.lineTo(lanes.x(depth - 0.5), lanes.y((low + high + 1) / 2));
      }
      context.stroke();
      if (lanes.step > 6) for (const move of chain) this._outline(context, move, 1.4);
    }

    at(x, y) {
      const found = this.lanes?.at(x, y);
      if (!found) return null;
      const { path } = this;
      const depth = Math.floor(found.t) + 1;
      if (this._indexed !== path) {
        this._indexed = path;
        this._byDepth = Map.groupBy(path.rows.keys(), (move) => path.depth[move]);
      }
      const move = (this._byDepth.get(depth) ?? []).find((each) => {
        const [, low, high] = this._span(each);
        return low <= found.lane && found.lane <= high;
      });
      if (move === undefined) return { t: found.t, module: null, move: null };
      return { t: found.t, module: path.modulesOf(move)[0], move: { path, move } };
    }

    legend() {
      return [
        ["", cubepath.faint("#59606a", 0.6), "", `${this.path.title}: a piece for each move, as early as it can be`],
        ["stroke", "", cubepath.colour("chain"), `longest chain, ${this.path.chain.length} moves`],
      ];
    }

    get said() {
      return `Heap of pieces of ${this.path.title}; the longest chain has ${this.path.chain.length} moves`;
    }
  }

  cubepath.Heap = Heap;
})((globalThis.cubepath ??= {}));
