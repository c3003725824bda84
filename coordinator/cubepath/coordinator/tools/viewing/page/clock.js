// The moment that is shown, and how it advances: both ways, at a speed, in a loop.
(function (cubepath) {
  "use strict";

  const SPEEDS = [0.25, 0.5, 1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1024];
  const LASTING_S = 20; // what a whole run takes about, unless it is very short or very long

  class Clock {
    /** @param {number} steps the length of the time axis */
    constructor(steps) {
      this.steps = steps;
      this.t = 0;
      this.way = 0;
      this.loop = null;
      this.looping = false;
      const wanted = Math.max(2, steps / LASTING_S);
      this.speed = SPEEDS.find((each) => each >= wanted) ?? SPEEDS.at(-1);
    }

    /** The part that is repeated, [from, until]. */
    get part() {
      return this.loop ?? [0, this.steps];
    }

    seek(t) {
      this.t = Math.max(0, Math.min(this.steps, t));
    }

    /** Play forwards (1) or backwards (-1), or pause (0); from an end, begin at the other one. */
    play(way) {
      this.way = way;
      const [from, until] = this.looping ? this.part : [0, this.steps];
      if (way > 0 && this.t >= until) this.t = from;
      if (way < 0 && this.t <= from) this.t = until;
    }

    /** Let some seconds go by; returns whether the moment has changed. */
    tick(seconds) {
      if (!this.way) return false;
      this.seek(this.t + this.way * seconds * this.speed);
      const [from, until] = this.looping ? this.part : [0, this.steps];
      if (this.way > 0 && this.t >= until) this._end(from, until);
      else if (this.way < 0 && this.t <= from) this._end(until, from);
      return true;
    }

    _end(again, here) {
      if (this.looping) this.t = again;
      else {
        this.t = here;
        this.way = 0;
      }
    }

    /** Set where the loop begins or ends, and repeat from now on. */
    bracket(side) {
      const [from, until] = this.part;
      const here = Math.round(this.t);
      const loop = side === "from" ? [here, until] : [from, here];
      if (loop[0] >= loop[1]) loop[side === "from" ? 1 : 0] = side === "from" ? this.steps : 0;
      this.loop = loop[0] < loop[1] ? loop : null;
      this.looping = this.loop !== null;
    }

    faster(by) {
      const at = SPEEDS.indexOf(this.speed) + by;
      this.speed = SPEEDS[Math.max(0, Math.min(SPEEDS.length - 1, at))];
    }
  }

  cubepath.Clock = Clock;
})((globalThis.cubepath ??= {}));
