// The time that is shown: played, stepped through, or gone to. Every frame is a time that a body has, the nearest to the clock.

import { nearest } from "./data.js";

const CALM = 0.5; // seconds between two frames for viewers who ask for less motion
const calm = matchMedia("(prefers-reduced-motion: reduce)");

export class Player {
  constructor(times, show, changed) {
    this.times = times;
    this.show = show;
    this.changed = changed; // whether it plays
    this.k = 0;
    this.clock = times[0];
    this.speed = 1;
    this.loop = false;
    this.playing = false;
  }

  get time() {
    return this.times[this.k];
  }

  get last() {
    return this.times.length - 1;
  }

  goTo(t) {
    if (!Number.isFinite(t)) throw new RangeError(`goTo needs a time, but it got ${t}.`);
    this.clock = Math.min(Math.max(t, this.times[0]), this.times[this.last]);
    this.k = nearest(this.times, this.clock);
    this.show(this.time);
  }

  goToFrame(k) {
    this.goTo(this.times[Math.min(Math.max(k, 0), this.last)]);
  }

  step(by) {
    this.pause();
    this.goToFrame(this.k + by);
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  pause() {
    this.playing = false;
    this.changed(false);
  }

  play() {
    if (this.last === 0) return;
    if (this.clock >= this.times[this.last]) this.clock = this.times[0];
    this.playing = true;
    this.before = undefined;
    this.changed(true);
    requestAnimationFrame((now) => this.tick(now));
  }

  tick(now) {
    if (!this.playing) return;
    // A page that was hidden goes on from where it was.
    const passed = this.before === undefined ? 0 : (now - this.before) / 1000;
    if (calm.matches && this.before !== undefined && passed < CALM) {
      requestAnimationFrame((next) => this.tick(next));
      return;
    }
    const elapsed = Math.min(passed, calm.matches ? CALM : 0.25);
    this.before = now;
    const [start, end] = [this.times[0], this.times[this.last]];
    let t = this.clock + elapsed * this.speed;
    if (t >= end && this.loop) t = start + ((t - start) % (end - start));
    this.goTo(t);
    if (t >= end) this.pause();
    else requestAnimationFrame((next) => this.tick(next));
  }
}
