// Worlds and paths: which sites there are, where each module is after each step, who makes a move.
(function (cubepath) {
  "use strict";

  /** What the paths of one scene are made of; docs/viewing.md has the fields of the data. */
  class World {
    /** @param {object} data */
    constructor(data) {
      Object.assign(this, data);
      this.count = data.start.length;
      this.sites = columns(data.sites);
      this.rows = columns(data.rows);
      this.turnTo(0);
    }

    /** See a world in three dimensions from another side: this many steps of the view from the first. */
    turnTo(steps) {
      this.camera = this.solids && new cubepath.Camera(this.solids, steps);
    }

    /** Left, right, low and high of a picture. */
    get frame() {
      return this.camera?.boxOf([this.sites, this.solids.fixed].flatMap(({ point }) => cubepath.pointsOf(point))) ?? this.box;
    }

    /**
     * Take further sites and rows; numbers go on from those that are known.
     * @param {{sites?: object, rows?: object}} more the same fields as at the beginning; `begins`
     *   has the ends of the new rows alone
     */
    extend(more) {
      for (const part of ["sites", "rows"]) {
        for (const [name, values] of Object.entries(more[part] ?? {})) this[part][name].push(...values);
      }
    }

    /** The sites between which a row takes modules, as [source, target, place in the table]. */
    motions(row) {
      const { begins, source, target } = this.rows;
      const found = [];
      for (let each = begins[row]; each < begins[row + 1]; each++) {
        found.push([source[each], target[each], each]);
      }
      return found;
    }

    /** The name of a row: its generator, and where it is placed. */
    nameOf(row) {
      const name = this.rows.generators[this.rows.generator[row]];
      return this.rows.at[row] ? `${name} at ${this.rows.at[row]}` : name;
    }
  }

  /** The columns of a table, as arrays that can grow. */
  function columns(table) {
    return Object.fromEntries(Object.entries(table).map(([name, values]) => [name, Array.from(values)]));
  }

  /**
   * A path that can be stood on: `step` is how many steps have been made, `sites` has the site of
   * each module there. Steps are appended one by one; going to another costs the moves between.
   */
  class Path {
    /**
     * @param {World} world
     * @param {object} data
     */
    constructor(world, data) {
      this.world = world;
      this.data = data;
      this.title = data.title;
      this.name = data.step;
      /** How many steps there were before the first, of a page that joined a run late. */
      this.before = data.before ?? 0;
      /** The number of moves up to the end of each step, and the row of each move. */
      this.ends = [];
      this.rows = [];
      /** The modules that make each move: from firstBy[move] on, the mover first. */
      this.by = [];
      this.firstBy = [0];
      /** For each module its moves, in order. */
      this.movesOf = Array.from({ length: world.count }, () => []);
      this.step = 0;
      this.sites = Array.from(world.start);
      this.on = new Map(this.sites.map((site, module) => [site, module]));
      this.largest = 0;
      this.below = Array.from(data.below);
      this.depth = Array.from(data.depth);
      this._chain = data.chain;
      let begin = 0;
      for (const end of data.ends) {
        this._append(data.rows.slice(begin, end));
        begin = end;
      }
      this.goTo(0);
    }

    /** The longest chain: from the last of the deepest moves down, each that the other waits for. */
    get chain() {
      if (this._chain === undefined) {
        this._chain = [];
        let move = -1;
        this.depth.forEach((depth, each) => { if (move < 0 || depth >= this.depth[move]) move = each; });
        for (; move >= 0; move = this.below[move]) this._chain.unshift(move);
      }
      return this._chain;
    }

    get steps() {
      return this.ends.length;
    }

    /**
     * Append a step: the rows of its moves, which commute, and for each of them the move that it
     * waits for and its depth.
     * @param {{rows: number[], below: number[], depth: number[]}} step
     */
    append({ rows, below, depth }) {
      this._append(rows);
      this.below.push(...below);
      this.depth.push(...depth);
      this._chain = undefined;
    }

    _append(rows) {
      this.goTo(this.steps);
      const first = this.rows.length;
      for (const row of rows) {
        const move = this.rows.push(row) - 1;
        const motions = this.world.motions(row);
        const modules = motions.map(([source]) => this.on.get(source));
        if (modules.includes(undefined)) {
          throw new Error(`${this.name} ${this.steps + 1}: nobody to make ${this.world.nameOf(row)}`);
        }
        for (const module of modules) this.movesOf[module].push(move);
        this.by.push(...modules);
        this.firstBy.push(this.by.length);
        this._make(move, 1);
      }
      this.ends.push(this.rows.length);
      this.largest = Math.max(this.largest, this.rows.length - first);
      this.step += 1;
    }

    /** Where the moves of a step begin; steps count from 1. */
    begin(step) {
      return step > 1 ? this.ends[step - 2] : 0;
    }

    /** The step of a move, by bisection. */
    stepOf(move) {
      let low = 0;
      let high = this.ends.length;
      while (low < high) {
        const middle = (low + high) >> 1;
        if (this.ends[middle] <= move) low = middle + 1;
        else high = middle;
      }
      return low + 1;
    }

    /** What a step is called: "round 4". */
    label(step) {
      return `${this.name} ${this.before + step}`;
    }

    /** The modules that a move takes along, the mover first. */
    modulesOf(move) {
      return this.by.slice(this.firstBy[move], this.firstBy[move + 1]);
    }

    /** Stand after this many steps. */
    goTo(step) {
      const wanted = Math.max(0, Math.min(step, this.steps));
      while (this.step < wanted) {
        for (let move = this.begin(this.step + 1); move < this.ends[this.step]; move++) {
          this._make(move, 1);
        }
        this.step += 1;
      }
      while (this.step > wanted) {
        for (let move = this.ends[this.step - 1] - 1; move >= this.begin(this.step); move--) {
          this._make(move, -1);
        }
        this.step -= 1;
      }
    }

    _make(move, way) {
      const { begins, source, target } = this.world.rows;
      const from = way > 0 ? source : target;
      const to = way > 0 ? target : source;
      const row = this.rows[move];
      const first = begins[row];
      const count = begins[row + 1] - first;
      // All leave before any arrives: one may come where another was.
      for (let each = 0; each < count; each++) this.on.delete(from[first + each]);
      for (let each = 0; each < count; each++) {
        const module = this.by[this.firstBy[move] + each];
        this.sites[module] = to[first + each];
        this.on.set(to[first + each], module);
      }
    }

    /** The motions of a step: {module, move, source, target, place}; none before the first. */
    motions(step) {
      const found = [];
      if (step < 1 || step > this.steps) return found;
      for (let move = this.begin(step); move < this.ends[step - 1]; move++) {
        this.world.motions(this.rows[move]).forEach(([source, target, place], each) => {
          found.push({ module: this.by[this.firstBy[move] + each], move, source, target, place });
        });
      }
      return found;
    }

    /** Whether the modules are at the goal where the path stands; null if there is none. */
    get reached() {
      return this.world.goal ? Array.from(this.world.goal).every((site) => this.on.has(site)) : null;
    }

    /** The last step up to `step` in which a module moves, and the move; null if there is none. */
    lastMove(module, step) {
      const moves = this.movesOf[module];
      const end = step > 0 ? this.ends[Math.min(step, this.steps) - 1] : 0;
      let low = 0;
      let high = moves.length;
      while (low < high) {
        const middle = (low + high) >> 1;
        if (moves[middle] < end) low = middle + 1;
        else high = middle;
      }
      return low ? moves[low - 1] : null;
    }
  }

  Object.assign(cubepath, { World, Path });
})((globalThis.cubepath ??= {}));
