# Not tried where it runs: an instructor's grading server. It needs no ROS.
#
#   docker build -t barc_grade .
#   docker run --rm --network none -v "$PWD/submissions:/in:ro" -v "$PWD/grades:/out" barc_grade
#
# The host's kernel confines each submission: Linux 5.13 or later, with Landlock.
FROM python:3.12-slim
COPY . /barc_sim
RUN sed -n '/^daqp==/,/[^\\]$/p' /barc_sim/requirements/test.txt >/tmp/lab_4.txt && \
    pip install --no-cache-dir --require-hashes --no-deps \
      -r /barc_sim/requirements/run.txt -r /tmp/lab_4.txt && \
    pip install --no-cache-dir --no-index --no-deps --no-build-isolation /barc_sim && \
    useradd --create-home grader && \
    install -d -o grader /out
USER grader
WORKDIR /home/grader
ENTRYPOINT ["barc", "grade", "--out", "/out"]
CMD ["/in"]
