# The live server: docker build -t bodysense . && docker run --rm -p 8765:8765 bodysense
# Other commands: docker run --rm -v "$PWD:/data" -w /data bodysense track take.bvh -o out.bvh (docs/deploy.md)
# Any image with Python 3.11 or later as `python`, and pip, can take the place of this one: --build-arg BASE=IMAGE
ARG BASE=python:3.11-slim
FROM ${BASE} AS build
COPY . /src
# The system has no C compiler here: the build takes the one of the package ziglang, which stays in this stage.
RUN python -m venv --without-pip /venv \
    && pip --python /venv/bin/python install --no-cache-dir --no-compile -c /src/constraints.txt \
        /src "/src/packages/live[shared]" \
    && find /venv -type d -name tests -prune -exec rm -r {} +

FROM ${BASE}
COPY --from=build /venv /venv
RUN useradd --system --uid 10001 --no-create-home --home-dir /nonexistent bodysense
USER 10001
ENV PATH=/venv/bin:$PATH PYTHONDONTWRITEBYTECODE=1 PYTHONUNBUFFERED=1
EXPOSE 8765
HEALTHCHECK --interval=10s --timeout=3s --start-period=20s \
    CMD ["python", "-c", "import urllib.request as u; u.urlopen('http://127.0.0.1:8765/healthz', timeout=2)"]
ENTRYPOINT ["bodysense"]
CMD ["serve", "--host", "0.0.0.0"]
