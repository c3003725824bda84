// How a module looks between two sites: it turns, or goes straight.
(function (cubepath) {
  "use strict";

  /**
   * @typedef {object} Pose
   * @property {number} shape as in `sites.shape`
   * @property {number} x middle
   * @property {number} y
   * @property {number} turn of a cell, in radians
   * @property {number} dx half of a bar, from its middle to one end
   * @property {number} dy
   * @property {number} site whose colour and word it has
   * @property {number} flip width of a box that turns over, 1 when it lies still
   * @property {number} alpha
   * @property {number[]} [point] middle of a cell in three dimensions
   * @property {[number[], number][]} [spins] by which this cell turned: axis and angle, in radians
   */

  const NONE = 0, CELL = 1, BAR = 2, BOX = 3, DOT = 4;
  const LEG = 7; // numbers of a leg: a point of an axis, a direction, the angle, or 0 if it is straight

  /** The pose of a module that stands at a site. @returns {Pose} */
  function poseAt(world, site) {
    const { shape, at, to } = world.sites;
    const x = at[2 * site], y = at[2 * site + 1], u = to[2 * site], v = to[2 * site + 1];
    const pose = {
      shape: shape[site], x: (x + u) / 2, y: (y + v) / 2, turn: 0,
      dx: (u - x) / 2, dy: (v - y) / 2, site, flip: 1, alpha: shape[site] === NONE ? 0 : 1,
    };
    if (!world.camera) return pose;
    const cell = { ...pose, shape: CELL, kind: world.sites.kind[site], spins: [] };
    return world.camera.placed(cell, world.sites.point.slice(3 * site, 3 * site + 3));
  }

  /** The pose of a module on its way, `part` from 0 to 1. @returns {Pose} */
  function poseBetween(world, source, target, place, part) {
    const one = poseAt(world, source), other = poseAt(world, target);
    if (part <= 0) return one;
    if (part >= 1) return other;
    const pose = { ...(part < 0.5 ? one : other) };
    if (one.shape === BAR && other.shape === BAR && !world.camera) {
      return world.joints ? rigid(one, other, part, pose) : elastic(one, other, part, pose);
    }
    const { point, spins } = along(world, place, part, one, other);
    if (world.camera) return world.camera.placed({ ...(spins.length ? one : pose), spins }, point);
    [pose.x, pose.y] = point;
    pose.turn = spins.reduce((sum, [axis, angle]) => sum + axis[2] * angle, 0);
    if (pose.shape === BOX) pose.flip = Math.abs(Math.cos(Math.PI * part));
    if (one.shape === NONE || other.shape === NONE) {
      pose.shape = one.shape === NONE ? other.shape : one.shape;
      pose.site = one.shape === NONE ? other.site : one.site;
      pose.alpha = one.shape === NONE ? part : 1 - part;
    }
    return pose;
  }

  /** Where a motion has led after a part of its legs, and how it turned there; straight if it has none. */
  function along(world, place, part, one, other) {
    const { legs, leg_begins } = world.rows, [from, until] = [leg_begins[place], leg_begins[place + 1]];
    const [start, end] = [one, other].map((pose) => pose.point ?? [pose.x, pose.y, 0]);
    if (from === until) return { point: cubepath.plus(start, cubepath.plus(end, start, -1), part), spins: [] };
    let point = start;
    const spins = [];
    const numbers = (each, at) => legs.slice(LEG * each + at, LEG * each + at + 3);
    const long = (each) => Math.abs(legs[LEG * each + 6]) || Math.hypot(...numbers(each, 3));
    let left = 0;
    for (let each = from; each < until; each++) left += part * long(each);
    for (let each = from; each < until && left > 0; each++) {
      const about = numbers(each, 0), axis = numbers(each, 3), angle = legs[LEG * each + 6];
      const done = Math.min(1, left / long(each));
      left -= done * long(each);
      if (angle) {
        point = cubepath.plus(about, cubepath.turned(cubepath.plus(point, about, -1), axis, done * angle));
        spins.push([axis, done * angle]);
      } else point = cubepath.plus(point, axis, done);
    }
    return { point, spins };
  }

  /** The ends of a diagonal that flips slide along two sides of its quadrilateral. */
  function elastic(one, other, part, pose) {
    const far = (way) => Math.hypot(one.x + one.dx - other.x - way * other.dx, one.y + one.dy - other.y - way * other.dy)
      + Math.hypot(one.x - one.dx - other.x + way * other.dx, one.y - one.dy - other.y + way * other.dy);
    const way = far(1) <= far(-1) ? 1 : -1;
    pose.x = one.x + part * (other.x - one.x);
    pose.y = one.y + part * (other.y - one.y);
    pose.dx = one.dx + part * (way * other.dx - one.dx);
    pose.dy = one.dy + part * (way * other.dy - one.dy);
    return pose;
  }

  /** A segment of an arm turns about the end that it keeps, or about its middle on the way. */
  function rigid(one, other, part, pose) {
    const ends = [[1, 1], [1, -1], [-1, 1], [-1, -1]];
    const kept = ends.find(([a, b]) =>
      Math.hypot(one.x + a * one.dx - other.x - b * other.dx, one.y + a * one.dy - other.y - b * other.dy) < 1e-3);
    const [a, b] = kept ?? [1, 1];
    const first = Math.atan2(a * one.dy, a * one.dx), last = Math.atan2(b * other.dy, b * other.dx);
    // Half a turn shows the same bar, unless one of its ends stays where it is.
    const angle = first + part * nearest(last - first, kept ? 2 * Math.PI : Math.PI);
    const before = Math.hypot(one.dx, one.dy), after = Math.hypot(other.dx, other.dy);
    const half = before + part * (after - before);
    pose.dx = half * Math.cos(angle);
    pose.dy = half * Math.sin(angle);
    if (kept) {
      pose.x = one.x + a * one.dx - pose.dx;
      pose.y = one.y + a * one.dy - pose.dy;
    } else {
      pose.x = one.x + part * (other.x - one.x);
      pose.y = one.y + part * (other.y - one.y);
    }
    return pose;
  }

  /** An angle without whole periods, between minus and plus half of one. */
  function nearest(angle, period) {
    return angle - period * Math.round(angle / period);
  }

  /** A step begins and ends gently. */
  function eased(part) {
    return part * part * (3 - 2 * part);
  }

  Object.assign(cubepath, { NONE, CELL, BAR, BOX, DOT, poseAt, poseBetween, eased });
})((globalThis.cubepath ??= {}));
