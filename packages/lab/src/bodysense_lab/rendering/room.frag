in vec3 world_normal;
in vec3 paint;
in float texture_kind;

vec4 material() {
    vec3 p = world_position;
    float grain = 0.9 + 0.2 * noise(p * 3.0) * noise(p * 17.0);
    if (texture_kind > 1.5) grain *= fract(p.x * 1.6) < 0.015 ? 0.7 : 1.0;  // boards of a floor
    else if (texture_kind > 0.5) grain *= fract(p.y * 0.8 + 0.3) < 0.012 ? 0.75 : 1.0;  // a rail on the wall
    return vec4(paint * grain, 0.0);
}

void main() { fragment = vec4(shown(material(), normalize(world_normal), lit()), 1.0); }
