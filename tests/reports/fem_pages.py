def markdown(r):
    return ""


def figure(r, p):
    pass
