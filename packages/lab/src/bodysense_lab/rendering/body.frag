uniform vec3 skin;
uniform vec3 hair;
uniform vec3 shirt;
uniform vec3 trousers;
uniform vec3 shoes;
uniform float stripes;
uniform vec3 left_eye;
uniform float sleeve_end;
uniform float neckline;
uniform float shirt_end;
uniform float shoe_top;
in vec3 world_normal;
in vec3 rest_position;
in float is_eye;
in float is_lip;

vec3 face(vec3 p) {
    vec3 eye = vec3(abs(p.x), p.y, p.z) - left_eye;
    if (is_eye > 0.5) {
        float off = length(eye.xy);
        return off < 0.0035 ? vec3(0.02) : (off < 0.0065 ? vec3(0.16, 0.10, 0.06) : vec3(0.75, 0.73, 0.70));
    }
    float line = left_eye.y + 0.062 - 0.9 * max(left_eye.z - 0.045 - p.z, 0.0);
    float temple = left_eye.y + 0.062 - 2.2 * max(abs(p.x) - 0.045, 0.0);
    line = min(line, temple);
    line = max(line, left_eye.y - 0.09);
    if (p.z < left_eye.z - 0.055 && p.y > line + 0.004 * sin(300.0 * p.x)) return hair;
    if (p.y > left_eye.y + 0.066 - 0.5 * max(abs(p.x) - 0.03, 0.0)) return hair;
    vec2 brow = vec2(eye.x - 0.002, eye.y - 0.021 + 2.5 * eye.x * eye.x);
    if (p.z > 0.0 && abs(brow.x) < 0.021 && abs(brow.y) < 0.0035) return mix(skin, hair, 0.8);
    vec3 color = mix(skin, skin * vec3(0.92, 0.62, 0.60), 0.8 * is_lip);
    float cheek = length(vec2(eye.x - 0.012, eye.y + 0.045));
    return color * mix(vec3(1.0), vec3(1.0, 0.90, 0.88), smoothstep(0.03, 0.0, cheek));
}

vec4 material() {
    vec3 p = rest_position;
    float across = abs(p.x);
    float low = neckline + 0.6 * max(across - 0.05, 0.0);
    bool is_head = p.y > low && across < 0.16, is_arm = across > sleeve_end;
    float grained = noise(p * (is_arm ? 60.0 : 350.0));
    if (is_head) return vec4(face(p), 1.0);
    if (is_arm) return vec4(skin * mix(vec3(1.0, 0.95, 0.94), vec3(1.0, 1.02, 1.02), grained), 1.0);
    if (p.y < shoe_top) return vec4(shoes, 0.0);
    if (p.y < shirt_end) return vec4(trousers * (0.92 + 0.16 * grained), 0.0);
    vec3 cloth = shirt * (0.94 + 0.12 * grained);
    if (stripes > 0.0 && fract(p.y / stripes) < 0.35) cloth = mix(cloth, 1.0 - cloth, 0.5);
    return vec4(cloth, 0.0);
}

void main() { fragment = exposed(shown(material(), normalize(world_normal), lit())); }
