uniform vec3 eye;
uniform vec3 lamp_toward[2];
uniform vec3 lamp_color[2];
uniform vec3 sky;

// The colour that a surface shows: its own (sRGB), and in the fourth place whether it is skin.
vec3 shown(vec4 surface, vec3 n, float visible) {
    vec3 albedo = pow(surface.rgb, vec3(2.2));
    float is_skin = surface.a;
    vec3 to_eye = normalize(eye - world_position);
    vec3 total = albedo * mix(0.45 * sky, sky, 0.5 + 0.5 * n.y) * (0.55 + 0.45 * max(dot(n, to_eye), 0.0));
    for (int k = 0; k < 2; ++k) {
        float arrives = k == 0 ? visible : 1.0;
        float facing = dot(n, lamp_toward[k]);
        // Light that enters skin comes out past its edge of shadow, and redder.
        vec3 wrap = is_skin * vec3(0.25, 0.08, 0.05);
        vec3 diffuse = max((vec3(facing) + wrap) / (1.0 + wrap), 0.0);
        diffuse *= vec3(min(arrives + 0.12 * is_skin, 1.0), arrives, arrives);
        vec3 half_way = normalize(lamp_toward[k] + to_eye);
        float shine = pow(max(dot(n, half_way), 0.0), 22.0) * mix(0.02, 0.09, is_skin);
        total += lamp_color[k] * (albedo * diffuse * 0.62 + shine * arrives * step(0.0, facing));
    }
    return pow(total / (1.0 + 0.25 * total), vec3(1.0 / 2.2));
}
