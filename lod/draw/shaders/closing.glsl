// How large points and lines must be so that what they belong to has no hole, for vertex shaders. gl_Position must be
// set before. Variant LINES: several copies of a line lie side by side.
uniform vec4 u_eye;                    // homogeneous: parallel rays come from a point at infinity
uniform float u_samples;               // samples that a length of 1 covers at depth 1
uniform float u_closing;               // diameter at which points leave no hole, width at which lines do, scene units

// Away from the picture's middle a length covers more samples, by 1 / cos² of the angle.
float closingSamples(float squared_distance) {
  float depth = gl_Position.w;
  return u_closing * u_samples * (u_eye.w > 0.0 ? sqrt(squared_distance) / (depth * depth) : 1.0);
}

#ifdef LINES
uniform int u_copies;                  // of each line to either side of its place: of flat ones, then of steep ones
uniform vec2 u_sample_size;            // in clip space
// A line covers one sample in each column, or in each row if it is steep. Copies beside it, at most a sample apart,
// make it as wide as is needed. Those of flat lines lie above each other, those of steep ones side by side; every line
// gets both, as it may turn from one to the other in perspective.
vec2 copyOffset(float squared_distance) {
  if (u_copies == 1) return vec2(0.0);
  float half_width = 0.5 * clamp(closingSamples(squared_distance) - 1.0, 0.0, float(u_copies - 1));
  bool is_flat = gl_InstanceID < u_copies;
  float place = float(is_flat ? gl_InstanceID : gl_InstanceID - u_copies) / float(u_copies - 1);
  float offset = (2.0 * place - 1.0) * half_width;
  return (is_flat ? vec2(0.0, offset) : vec2(offset, 0.0)) * u_sample_size;
}
#endif
