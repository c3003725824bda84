// The modules of one path at a moment, with claims, messages, and which modules wait.
(function (cubepath) {
  "use strict";

  const READABLE = 15; // pixels of a cell in which a number can be read
  const TINY = 3; // pixels of a cell below which it has no outline, and is a spot that can be seen
  const PIECES = 12; // of each leg of the way of a module
  const MANY = 150; // modules from which on each look of a module is drawn once, and then copied

  class Stage {
    /**
     * @param {HTMLCanvasElement} canvas
     * @param {Path} path
     * @param {object} view what is chosen in the page: hovered, claims, messages
     */
    constructor(canvas, path, view) {
      this.canvas = canvas;
      this.view = view;
      this.show(path);
    }

    /** Show another path. */
    show(path) {
      this.path = path;
      this.world = path.world;
      this.outline = cubepath.outlined(this.world.outline);
      this.moment = 0;
      this.moving = new Map();
      this.forget();
    }

    /** Draw everything anew: the size or the colours have changed. */
    forget() {
      this.layers = null;
      this.stamps = new Map();
    }

    /** Draw the moment `t`: whole steps, and the part of the next one. */
    draw(t) {
      const { context, width, height, ratio, changed } = cubepath.prepared(this.canvas);
      if (!width || !height) return;
      if (changed || !this.layers) this._prepare(width, height, ratio);
      this.moment = Math.min(t, this.path.steps);
      const step = Math.floor(this.moment), part = this.moment - step;
      this.path.goTo(step);
      const moving = part > 0 ? this.path.motions(step + 1) : [];
      const last = part > 0 ? moving : this.path.motions(step);
      this.moving = new Map(moving.map((each) => [each.module, each]));
      context.setTransform(1, 0, 0, 1, 0, 0);
      context.clearRect(0, 0, this.canvas.width, this.canvas.height);
      context.drawImage(this.layers[0], 0, 0);
      this._toCells(context, ratio);
      const now = part > 0 ? step + 1 : step;
      this.drawn = this.world.camera ? this._bodies(last) : [];
      for (const body of this.drawn) this._body(context, body);
      this._granted(context, now);
      this._traces(context, last);
      // A goal is seen on who stands in it, and does not cross out the number of who goes by.
      const passes = moving.some(({ source }) => this.world.sites.shape[source] === cubepath.CELL);
      const before = () => {
        context.save();
        context.setTransform(1, 0, 0, 1, 0, 0);
        context.drawImage(this.layers[1], 0, 0);
        context.restore();
      };
      if (!this.world.camera) this._modules(context, moving, last, cubepath.eased(part), passes ? before : () => {});
      this._lost(context, now);
      if (this.view.messages) this._messages(context, now);
      this._chosen(context);
      if (!passes) before();
    }

    _prepare(width, height, ratio) {
      const [left, right, low, high] = this.world.frame;
      this.scale = Math.min(width / (right - left), height / (high - low));
      this.ratio = ratio;
      this.left = width / 2 - (this.scale * (left + right)) / 2;
      this.top = height / 2 + (this.scale * (low + high)) / 2;
      this.layers = [this.world.behind, this.world.before].map((layer) => {
        const canvas = cubepath.spare(this.canvas);
        const context = canvas.getContext("2d");
        this._toCells(context, ratio);
        if (!this.world.camera) cubepath.drawLayer(context, layer, this.scale);
        return canvas;
      });
      this.stamps.clear();
    }

    _toCells(context, ratio) {
      context.setTransform(
        ratio * this.scale, 0, 0, -ratio * this.scale, ratio * this.left, ratio * this.top);
    }

    /** Where each module that moved, or is moving, comes from. */
    _traces(context, last) {
      context.save();
      context.globalAlpha = 0.3;
      context.lineWidth = 0.1;
      const ways = new Map(); // one stroke for all of a colour
      for (const { module, source, target, place } of last) {
        const pose = cubepath.poseAt(this.world, source);
        if (pose.shape === cubepath.BOX) continue; // it stays where it is
        if (!this.world.camera) this._module(context, module, pose, {});
        if (pose.shape !== cubepath.CELL) continue;
        const colour = this._colour(module, source);
        if (!ways.has(colour)) ways.set(colour, new Path2D());
        const way = ways.get(colour), { leg_begins } = this.world.rows;
        const pieces = PIECES * (leg_begins[place + 1] - leg_begins[place]) || 1;
        way.moveTo(pose.x, pose.y);
        for (let piece = 1; piece <= pieces; piece++) {
          const there = cubepath.poseBetween(this.world, source, target, place, piece / pieces);
          way.lineTo(there.x, there.y);
        }
      }
      for (const [colour, way] of ways) {
        context.strokeStyle = colour;
        context.stroke(way);
      }
      context.restore();
    }

    _modules(context, moving, last, part, before) {
      const stirred = new Set(last.map((each) => each.module));
      const words = this.scale >= READABLE;
      const drawn = new Set();
      this.path.sites.forEach((site, module) => {
        if (stirred.has(module)) return;
        this._module(context, module, cubepath.poseAt(this.world, site), { words });
      });
      before();
      for (const { module, source, target, place } of moving) {
        const pose = cubepath.poseBetween(this.world, source, target, place, part);
        this._module(context, module, pose, { words, stirred: true });
        drawn.add(module);
      }
      for (const module of stirred) {
        if (drawn.has(module)) continue;
        const pose = cubepath.poseAt(this.world, this.path.sites[module]);
        this._module(context, module, pose, { words, stirred: true });
      }
      if (this.world.joints) this._joints(context);
    }

    /** All that has a body in three dimensions, in the order in which it is drawn. */
    _bodies(last) {
      const { world, path } = this, { fixed } = world.solids, stirred = new Set(last.map((each) => each.module));
      const ghosts = last.map(({ module, source }) => ({ ...cubepath.poseAt(world, source), alpha: 0.3, colour: this._colour(module, source) }));
      const modules = path.sites.map((site, module) => ({
        ...this.poseOf(module), module, moving: this.moving.has(module), stirred: stirred.has(module), colour: this._colour(module, site),
      }));
      const taken = new Set(modules.filter(({ moving }) => !moving).map(({ point }) => point.join()));
      const others = cubepath.pointsOf(fixed.point).map((point, each) => {
        const colour = fixed.colour[each], outlined = colour !== "wall";
        const alpha = !outlined ? 1 : taken.has(point.join()) ? 0 : 0.15;
        return world.camera.placed({ kind: fixed.kind[each], spins: [], outlined, alpha, colour: cubepath.colour(colour) }, point);
      });
      const joints = world.joints ? modules.flatMap((body) => world.camera.jointsOf({ ...body, colour: cubepath.colour("paper"), stirred: true })) : [];
      // In one place a goal is seen on the module, and a module on the rest of another.
      return world.camera.inOrder([...ghosts, ...modules, ...joints, ...others]);
    }

    /** The faces of a body. */
    _body(context, { x, y, ...body }) {
      const { camera, modules } = this.world, { colour, outlined, faces } = body;
      context.save();
      context.translate(x, y);
      context.lineJoin = "round";
      context.lineWidth = Math.max(outlined ? 0.05 : body.stirred ? 0.06 : 0.025, 0.75 / this.scale);
      context.strokeStyle = outlined ? colour : cubepath.colour(body.stirred ? "ink" : "rim");
      const part = body.alpha ? "whole" : "inner"; // on the faces of what stands there
      for (const { [part]: shape, light } of faces) {
        context.globalAlpha = body.alpha;
        context.fillStyle = outlined ? colour : cubepath.shaded(colour, light);
        context.fill(shape);
        if (outlined) context.globalAlpha = 1;
        if (this.scale >= TINY) context.stroke(shape);
      }
      if (body.module !== undefined && this.scale >= READABLE) {
        const [u, v] = faces[0].middle;
        cubepath.word(context, modules.word[body.module], u, v, 0.42 * camera.wide, cubepath.inkOn(colour));
      }
      context.restore();
    }

    _colour(module, site) {
      return this.world.sites.colour[site] || this.world.modules.colour[module];
    }

    _module(context, module, pose, { words, stirred }) {
      if (pose.shape === cubepath.NONE || !pose.alpha) return;
      const colour = this._colour(module, pose.site);
      if (pose.shape === cubepath.CELL && this.scale < TINY) {
        const side = Math.max(0.9, (stirred ? 2.5 : 1.5) / this.scale);
        context.fillStyle = stirred ? cubepath.colour("ink") : colour;
        context.fillRect(pose.x - side / 2, pose.y - side / 2, side, side);
        return;
      }
      if (pose.shape === cubepath.CELL && !pose.turn && this.path.sites.length >= MANY) {
        this._stamp(context, pose, colour, words ? this.world.modules.word[module] : "", stirred);
        return;
      }
      context.save();
      context.globalAlpha *= pose.alpha;
      context.fillStyle = colour;
      context.lineJoin = "round";
      if (pose.shape === cubepath.BAR) this._bar(context, pose, colour, stirred);
      else if (pose.shape === cubepath.DOT) {
        context.fillStyle = cubepath.colour("ink");
        context.beginPath();
        context.arc(pose.x, pose.y, 0.17, 0, 2 * Math.PI);
        context.fill();
      } else {
        const word = pose.shape === cubepath.BOX ? this.world.sites.word[pose.site] : this.world.modules.word[module];
        context.translate(pose.x, pose.y);
        if (pose.turn) context.rotate(pose.turn);
        if (pose.flip !== 1) context.scale(Math.max(pose.flip, 0.02), 1);
        this._cell(context, colour, stirred);
        if (pose.turn) context.rotate(-pose.turn);
        if (words) cubepath.word(context, word, 0, 0, 1, cubepath.inkOn(colour));
      }
      context.restore();
    }

    /** A cell around 0, 0. */
    _cell(context, colour, stirred) {
      context.fillStyle = colour;
      context.fill(this.outline);
      context.strokeStyle = cubepath.colour(stirred ? "ink" : "rim");
      const [part, least, most] = stirred ? [0.07, 1.5, 3.5] : [0.03, 0.75, 1.5];
      context.lineWidth = Math.min(Math.max(part, least / this.scale), most / this.scale);
      context.lineJoin = "round";
      context.stroke(this.outline);
    }

    /** Copy a cell that looks like one that was drawn before: of hundreds few differ. */
    _stamp(context, pose, colour, word, stirred) {
      const key = `${colour} ${word} ${Boolean(stirred)}`;
      const half = 0.65; // of the side, in cells: there is room for the outline
      let stamp = this.stamps.get(key);
      if (!stamp) {
        const pixels = this.scale * this.ratio;
        stamp = document.createElement("canvas");
        stamp.width = stamp.height = Math.ceil(2 * half * pixels);
        const own = stamp.getContext("2d");
        own.setTransform(pixels, 0, 0, -pixels, half * pixels, half * pixels);
        this._cell(own, colour, stirred);
        if (word) cubepath.word(own, word, 0, 0, 1, cubepath.inkOn(colour));
        this.stamps.set(key, stamp);
      }
      // At whole pixels nothing is to be interpolated, which takes most of the time.
      const x = this.ratio * (this.left + this.scale * (pose.x - half));
      const y = this.ratio * (this.top - this.scale * (pose.y + half));
      context.save();
      context.setTransform(1, 0, 0, 1, 0, 0);
      context.drawImage(stamp, Math.round(x), Math.round(y));
      context.restore();
    }

    _bar(context, pose, colour, stirred) {
      context.lineCap = this.world.joints ? "round" : "butt";
      const thick = Math.max(this.world.thick, 2 / this.scale);
      const line = () => {
        context.beginPath();
        context.moveTo(pose.x - pose.dx, pose.y - pose.dy);
        context.lineTo(pose.x + pose.dx, pose.y + pose.dy);
        context.stroke();
      };
      if (stirred) {
        context.strokeStyle = cubepath.colour("ink");
        context.lineWidth = thick + Math.max(0.08, 3 / this.scale);
        line();
      }
      const halo = cubepath.colour("halo"); // dark bars are hard to see on dark ground
      if (!stirred && halo !== "none") {
        context.strokeStyle = halo;
        context.lineWidth = thick + Math.max(0.03, 1.5 / this.scale);
        line();
      }
      context.strokeStyle = colour;
      context.lineWidth = thick;
      line();
      if (!this.world.joints) return;
      context.fillStyle = cubepath.colour("paper");
      context.strokeStyle = cubepath.colour("ink");
      context.lineWidth = 0.05;
      for (const way of [1, -1]) {
        context.beginPath();
        context.arc(pose.x + way * pose.dx, pose.y + way * pose.dy, 0.1, 0, 2 * Math.PI);
        context.fill();
        context.stroke();
      }
    }

    /** Marked vertices lie above the joints of all segments. */
    _joints(context) {
      this.path.sites.forEach((site, module) => {
        if (this.world.sites.shape[site] === cubepath.DOT) {
          this._module(context, module, cubepath.poseAt(this.world, site), {});
        }
      });
    }

    /** The claims of a step that were granted: lines to where they lead, below the modules. */
    _granted(context, step) {
      context.save();
      context.strokeStyle = cubepath.colour("quiet");
      context.lineWidth = Math.max(0.05, 1.2 / this.scale);
      for (const { source, target, lost } of this._claimsOf(step)) {
        const one = cubepath.poseAt(this.world, source), other = cubepath.poseAt(this.world, target);
        if (lost || one.shape !== cubepath.CELL) continue;
        context.beginPath();
        context.moveTo(one.x, one.y);
        context.lineTo(other.x, other.y);
        context.stroke();
        context.beginPath();
        context.arc(other.x, other.y, 0.12, 0, 2 * Math.PI);
        context.stroke();
      }
      context.restore();
    }

    /** The claims of a step that were lost: crosses, and lines to where they would have led. */
    _lost(context, step) {
      context.save();
      context.strokeStyle = cubepath.colour("lost");
      context.lineWidth = Math.max(0.08, 2 / this.scale);
      context.lineCap = "round";
      for (const { source, target, lost } of this._claimsOf(step)) {
        if (!lost) continue;
        const one = cubepath.poseAt(this.world, source), other = cubepath.poseAt(this.world, target);
        const aside = one.shape === cubepath.BOX ? 0.3 : 0;
        const moves = one.shape === cubepath.CELL;
        const x = (moves ? other.x : one.x) - aside, y = (moves ? other.y : one.y) + aside, arm = 0.12;
        context.beginPath();
        context.moveTo(x - arm, y - arm);
        context.lineTo(x + arm, y + arm);
        context.moveTo(x - arm, y + arm);
        context.lineTo(x + arm, y - arm);
        context.stroke();
        if (!moves) continue;
        context.setLineDash([0.12, 0.18]);
        context.beginPath();
        context.moveTo(one.x + 0.4 * (x - one.x), one.y + 0.4 * (y - one.y));
        context.lineTo(x - 0.15 * (x - one.x), y - 0.15 * (y - one.y));
        context.stroke();
        context.setLineDash([]);
      }
      context.restore();
    }

    /** The claims of a step: where the mover is and would go, and whether it lost. */
    _claimsOf(step) {
      const { claims } = this.path.data;
      if (!this.view.claims || !claims || step < 1 || step > claims.ends.length) return [];
      const found = [];
      for (let each = step > 1 ? claims.ends[step - 2] : 0; each < claims.ends[step - 1]; each++) {
        const [source, target] = this.world.motions(claims.row[each])[0];
        found.push({ source, target, lost: claims.won[each] === 0 });
      }
      return found;
    }

    /** Deliveries in a step, as thin curves from the senders. */
    _messages(context, step) {
      const heard = this.path.data.heard;
      if (!heard?.ends || step < 1 || step > heard.ends.length) return;
      this.path.goTo(step - 1);
      const spots = this.path.sites.map((site) => cubepath.poseAt(this.world, site));
      this.path.goTo(Math.floor(this.moment));
      context.save();
      context.strokeStyle = cubepath.colour("accent");
      context.lineWidth = 1 / this.scale;
      context.globalAlpha = 0.45;
      context.beginPath();
      for (let each = step > 1 ? heard.ends[step - 2] : 0; each < heard.ends[step - 1]; each++) {
        const one = spots[heard.from[each]], other = spots[heard.to[each]];
        if (one === other) continue;
        const bend = 0.08 * (heard.kind[each] + 1);
        context.moveTo(one.x, one.y);
        context.quadraticCurveTo(
          (one.x + other.x) / 2 - bend * (other.y - one.y), (one.y + other.y) / 2 + bend * (other.x - one.x),
          other.x, other.y);
      }
      context.stroke();
      context.restore();
    }

    /** A ring around the chosen module, and a line to whom its last move waited for. */
    _chosen(context) {
      const module = this.view.module;
      if (module === null || module >= this.path.sites.length) return;
      const here = this.poseOf(module);
      context.save();
      context.strokeStyle = cubepath.colour("accent");
      context.lineWidth = Math.max(0.09, 2.5 / this.scale);
      context.beginPath();
      if (here.shape === cubepath.BAR) {
        // Two lines beside it: a ring would be around what lies near its middle.
        const long = Math.hypot(here.dx, here.dy), side = Math.max(this.world.thick, 2 / this.scale) / 2 + 0.12;
        const u = (-here.dy / long) * side, v = (here.dx / long) * side;
        for (const way of [1, -1]) {
          context.moveTo(here.x - here.dx + way * u, here.y - here.dy + way * v);
          context.lineTo(here.x + here.dx + way * u, here.y + here.dy + way * v);
        }
      } else context.arc(here.x, here.y, 0.58, 0, 2 * Math.PI);
      context.stroke();
      const move = this.path.lastMove(module, Math.ceil(this.moment));
      const below = move === null ? -1 : this.path.below[move];
      if (below >= 0) {
        const other = this.poseOf(this.path.modulesOf(below)[0]);
        context.setLineDash([0.2, 0.15]);
        context.beginPath();
        context.moveTo(here.x, here.y);
        context.lineTo(other.x, other.y);
        context.stroke();
      }
      context.restore();
    }

    /** The pose of a module at the moment that is shown. */
    poseOf(module) {
      const step = Math.floor(this.moment);
      const motion = this.moving.get(module);
      if (!motion) return cubepath.poseAt(this.world, this.path.sites[module]);
      const part = cubepath.eased(this.moment - step);
      return cubepath.poseBetween(this.world, motion.source, motion.target, motion.place, part);
    }

    /** The module at a point of the canvas, in CSS pixels; null if there is none. */
    moduleAt(x, y) {
      if (!this.scale) return null;
      const u = (x - this.left) / this.scale, v = (this.top - y) / this.scale;
      let best = null, least = 0.55;
      if (this.world.camera) {
        const context = this.canvas.getContext("2d");
        context.setTransform(1, 0, 0, 1, 0, 0);
        const met = this.drawn.findLast(({ alpha, faces, x: right, y: up }) =>
          alpha === 1 && faces.some(({ whole }) => context.isPointInPath(whole, u - right, v - up)));
        return met?.module ?? null;
      }
      this.path.sites.forEach((_, module) => {
        const pose = this.poseOf(module);
        if (pose.shape === cubepath.NONE) return;
        const far = pose.shape === cubepath.BAR ? 1.8 * toBar(pose, u, v) : Math.hypot(u - pose.x, v - pose.y);
        if (far < least) [best, least] = [module, far];
      });
      return best;
    }
  }

  /** How far a point is from a bar. */
  function toBar({ x, y, dx, dy }, u, v) {
    const along = ((u - x) * dx + (v - y) * dy) / (dx * dx + dy * dy || 1);
    const kept = Math.max(-1, Math.min(1, along));
    return Math.hypot(u - x - kept * dx, v - y - kept * dy);
  }

  cubepath.Stage = Stage;
})((globalThis.cubepath ??= {}));
