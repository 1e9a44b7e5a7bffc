import os

for i in range(3, 64):
    try:
        os.write(i, bytes(500))
    except OSError:
        pass
