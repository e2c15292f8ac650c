uniform vec4 u_steps[5];               // the legend: rgb is a step's colour, w its upper end in pixels
vec3 tinted(vec3 color, float pixels) {
  int step = 0;
  // A texel a pixel is as fine as a picture gets, so roundings must not push it into the next step.
  while (step < 4 && pixels > 1.1 * u_steps[step].w) ++step;
  return u_steps[step].rgb * (0.35 + 0.65 * dot(color, vec3(0.299, 0.587, 0.114)));
}
