uniform sampler2DShadow shadow;
uniform float shadow_texel;
uniform float grain;
uniform float frame;
in vec4 light_position;
out vec4 fragment;

// How much of the first lamp's light arrives, 0 to 1.
float lit() {
    vec3 p = light_position.xyz / light_position.w * 0.5 + 0.5;
    if (any(lessThan(p, vec3(0.0))) || any(greaterThan(p, vec3(1.0)))) return 1.0;
    float sum = 0.0;
    for (int x = 0; x < 2; ++x)
        for (int y = 0; y < 2; ++y)
            sum += texture(shadow, vec3(p.xy + (vec2(x, y) - 0.5) * 1.6 * shadow_texel, p.z - 0.0025));
    return sum / 4.0;
}

// With the noise of a sensor.
vec4 exposed(vec3 color) {
    vec3 p = fract(vec3(gl_FragCoord.xyx + 61.7 * frame) * 0.1031);
    p += dot(p, p.yzx + 33.33);
    return vec4(color + grain * 3.4 * (fract((p.x + p.y) * p.z) - 0.5), 1.0);
}
