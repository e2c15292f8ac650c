#ifdef SECTION
in float v_beyond;
#endif
void main() {
#ifdef SECTION
  if (v_beyond > 0.0) discard;
#endif
}
