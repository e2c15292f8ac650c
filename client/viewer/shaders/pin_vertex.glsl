uniform vec4 u_clip;
void main() {
  gl_Position = u_clip;
  gl_PointSize = 3.0;
}
