// Writes RGBA of unsigned integers, the one integer format that GLES 3.0 and WebGL2 always read back.
in highp float v_eye_depth;
in highp vec3 v_position;
uniform highp vec4 u_section;
layout(location = 0) out highp uvec4 o_depth;
void main() {
  if (dot(u_section.xyz, v_position) > u_section.w) discard;
  o_depth = uvec4(floatBitsToUint(v_eye_depth), 1u, 0u, 0u);
}
