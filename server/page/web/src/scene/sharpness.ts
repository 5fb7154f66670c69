const SLOW_S = 0.06;
const PAUSE_S = 1; // longer than that was no drawing: the page was out of sight
const PICTURES = 24;
const LEAST = 0.75;

/**
 * How many of the screen's pixels the scene is drawn with, along each side: all, until a run of pictures took so long that motion
 * stutters, as without a graphics processor; then fewer for good. Not so few that lines blur.
 */
export class Sharpness {
  scale = 1;
  private sum_s = 0;
  private pictures = 0;

  /** The time from the picture drawn before to this one; true where the scale has changed. */
  took(seconds: number): boolean {
    if (seconds > PAUSE_S) return false;
    this.sum_s += seconds;
    if (++this.pictures < PICTURES) return false;
    const slow = this.sum_s / this.pictures > SLOW_S && this.scale > LEAST;
    this.sum_s = this.pictures = 0;
    if (slow) this.scale = LEAST;
    return slow;
  }
}
