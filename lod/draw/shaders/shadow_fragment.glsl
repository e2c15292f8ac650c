// Shadow maps have depth alone.
void main() {
}
