// The plane of a chart: time steps from left to right, below the slider, and lanes from top to bottom.
(function (cubepath) {
  "use strict";

  const LEFT = 68, RIGHT = 12, TOP = 4, BOTTOM = 20;
  document.documentElement.style.setProperty("--left", `${LEFT}px`);
  document.documentElement.style.setProperty("--right", `${RIGHT}px`);

  /** Multiples of a round number, at most `most` of them. */
  function ticks(first, last, most) {
    let step = 1;
    for (let digits = 1; Math.floor(last / step) - Math.floor((first - 1) / step) > most; digits++) {
      step = [1, 2, 5][digits % 3] * 10 ** Math.floor(digits / 3);
    }
    const found = [];
    for (let tick = Math.ceil(first / step) * step; tick <= last; tick += step) found.push(tick);
    return found;
  }

  class Lanes {
    /** Lay out a chart of a number of steps and lanes in a box of CSS pixels. */
    constructor(width, height, steps, count) {
      Object.assign(this, { width, height, steps, count });
      this.wide = Math.max(1, width - LEFT - RIGHT);
      this.tall = Math.max(1, height - TOP - BOTTOM);
      this.lane = Math.min(this.tall / Math.max(1, count), 44);
      this.step = this.wide / Math.max(1, steps);
    }

    x(t) {
      return LEFT + t * this.step;
    }

    y(lane) {
      return TOP + lane * this.lane;
    }

    /** The time and the lane at a point; null outside. */
    at(x, y) {
      const t = (x - LEFT) / this.step, lane = Math.floor((y - TOP) / this.lane);
      if (t < 0 || t > this.steps || lane < 0 || lane >= this.count) return null;
      return { t, lane };
    }

    /** Draw bands, ticks, the names of the lanes, and what both axes are. */
    ground(context, names, what) {
      const bottom = this.y(this.count);
      context.fillStyle = cubepath.colour("band");
      if (this.lane >= 4) {
        for (let lane = 0; lane < this.count; lane += 2) {
          context.fillRect(LEFT, this.y(lane), this.wide, this.lane);
        }
      }
      context.fillStyle = cubepath.colour("quiet");
      context.font = '11px system-ui, "DejaVu Sans", sans-serif';
      context.textAlign = "right";
      context.textBaseline = "middle";
      for (const lane of ticks(0, this.count - 1, this.tall / 15)) {
        // A name that is too long would be unreadable if it were squeezed, and hide others if not.
        const name = names(lane);
        if (context.measureText(name).width <= LEFT - 22) context.fillText(name, LEFT - 7, Math.max(6, this.y(lane + 0.5)));
      }
      context.textAlign = "center";
      context.textBaseline = "top";
      for (const step of ticks(1, this.steps, this.wide / 60)) {
        context.fillText(String(step), this.x(step - 0.5), bottom + 5);
      }
      context.textAlign = "right";
      context.fillText(what.step, LEFT - 7, bottom + 5);
      context.save();
      context.translate(6, TOP + (bottom - TOP) / 2);
      context.rotate(-Math.PI / 2);
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.fillText(what.lane, 0, 0);
      context.restore();
    }

    /** Draw a line where a step begins that has a mark. */
    mark(context, step) {
      const x = this.x(Math.max(0, step - 1));
      context.strokeStyle = cubepath.colour("mark");
      context.lineWidth = 2;
      context.setLineDash([5, 3]);
      context.beginPath();
      context.moveTo(x, TOP);
      context.lineTo(x, this.y(this.count));
      context.stroke();
      context.setLineDash([]);
    }

    /** Draw where the clock is, and the part that is repeated. */
    cursor(context, clock) {
      const bottom = this.y(this.count);
      if (clock.looping && clock.loop) {
        context.save();
        context.globalAlpha = 0.1;
        context.fillStyle = cubepath.colour("accent");
        context.fillRect(this.x(clock.loop[0]), TOP, (clock.loop[1] - clock.loop[0]) * this.step, bottom - TOP);
        context.restore();
      }
      context.strokeStyle = cubepath.colour("accent");
      context.lineWidth = 1.5;
      context.beginPath();
      context.moveTo(this.x(clock.t), TOP - 4);
      context.lineTo(this.x(clock.t), bottom + 3);
      context.stroke();
    }
  }

  /** A chart that keeps what is the same in every frame. */
  class Chart {
    constructor(canvas, view) {
      Object.assign(this, { canvas, view, kept: null });
    }

    forget() {
      this.kept = null;
    }

    draw() {
      const { context, width, height, ratio, changed } = cubepath.prepared(this.canvas);
      if (!width || !height) return;
      if (changed || !this.kept) {
        this.kept = cubepath.spare(this.canvas);
        const own = this.kept.getContext("2d");
        own.setTransform(ratio, 0, 0, ratio, 0, 0);
        this._prepare(own, width, height);
      }
      context.setTransform(1, 0, 0, 1, 0, 0);
      context.clearRect(0, 0, this.canvas.width, this.canvas.height);
      context.drawImage(this.kept, 0, 0);
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      this._look(context);
      this.lanes.cursor(context, this.view.clock);
    }
  }

  Object.assign(cubepath, { Chart, Lanes });
})((globalThis.cubepath ??= {}));
