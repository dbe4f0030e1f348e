// The room as it was drawn once with all of the first lamp's light, and once without.
uniform sampler2D bright;
uniform sampler2D dark;
void main() {
    ivec2 place = ivec2(gl_FragCoord.xy);
    fragment = exposed(mix(texelFetch(dark, place, 0).rgb, texelFetch(bright, place, 0).rgb, lit()));
}
