#version 330
// A skinned vertex; where the body is dressed, its clothes lie a little outside of it.
uniform mat4 camera;
uniform mat4 light;
uniform float sleeve_end;    // m from the middle, in the T-pose
uniform float neckline;      // m above the floor, likewise
uniform float shirt_end;
uniform float shoe_top;
in vec3 position;
in vec3 normal;
in vec3 rest;
in float part;
out vec3 world_position;
out vec3 world_normal;
out vec3 rest_position;
out vec4 light_position;
out float is_eye;
out float is_lip;

float dressed(vec3 p) {
    float across = abs(p.x);
    float low = neckline + 0.6 * max(across - 0.05, 0.0);
    if (p.y > low && across < 0.16) return 0.0;
    if (across > sleeve_end) return 0.0;
    float cloth = p.y < shoe_top ? 0.004 : (p.y < shirt_end ? 0.006 : 0.011);
    float limb = across > 0.2 ? 0.8 + 0.5 * smoothstep(0.2, sleeve_end, across) : 1.0;
    return cloth * limb;
}

void main() {
    vec3 out_of_skin = normalize(normal);
    float folds = 0.7 + 0.3 * sin(38.0 * rest.y + 9.0 * sin(11.0 * rest.x) + 5.0 * rest.z);
    vec3 p = position + out_of_skin * dressed(rest) * folds;
    world_position = p;
    world_normal = out_of_skin;
    rest_position = rest;
    is_eye = part == 1.0 ? 1.0 : 0.0;
    is_lip = part == 2.0 ? 1.0 : 0.0;
    light_position = light * vec4(p, 1.0);
    gl_Position = camera * vec4(p, 1.0);
}
