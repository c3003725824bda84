// How a module looks between two sites: it turns about a corner, or goes straight.
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
   */

  const NONE = 0, CELL = 1, BAR = 2, BOX = 3, DOT = 4;

  /** The pose of a module that stands at a site. @returns {Pose} */
  function poseAt(world, site) {
    const { shape, at, to } = world.sites;
    const x = at[2 * site], y = at[2 * site + 1], u = to[2 * site], v = to[2 * site + 1];
    return {
      shape: shape[site], x: (x + u) / 2, y: (y + v) / 2, turn: 0,
      dx: (u - x) / 2, dy: (v - y) / 2, site, flip: 1, alpha: shape[site] === NONE ? 0 : 1,
    };
  }

  /** The pose of a module on its way, `part` from 0 to 1. @returns {Pose} */
  function poseBetween(world, source, target, place, part) {
    const one = poseAt(world, source), other = poseAt(world, target);
    if (part <= 0) return one;
    if (part >= 1) return other;
    const pose = { ...(part < 0.5 ? one : other) };
    if (one.shape === BAR && other.shape === BAR) {
      return world.joints ? rigid(one, other, part, pose) : elastic(one, other, part, pose);
    }
    const turn = world.rows.turn[place];
    if (!turn) {
      pose.x = one.x + part * (other.x - one.x);
      pose.y = one.y + part * (other.y - one.y);
    } else {
      const cx = world.rows.corner[2 * place], cy = world.rows.corner[2 * place + 1];
      const cos = Math.cos(part * turn), sin = Math.sin(part * turn);
      pose.x = cx + cos * (one.x - cx) - sin * (one.y - cy);
      pose.y = cy + sin * (one.x - cx) + cos * (one.y - cy);
      pose.turn = part * turn;
    }
    if (pose.shape === BOX) pose.flip = Math.abs(Math.cos(Math.PI * part));
    if (one.shape === NONE || other.shape === NONE) {
      pose.shape = one.shape === NONE ? other.shape : one.shape;
      pose.site = one.shape === NONE ? other.site : one.site;
      pose.alpha = one.shape === NONE ? part : 1 - part;
    }
    return pose;
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
